"""Fits of Table 2 under one changed assumption, and how near its elastic part then comes to the published one.

The elastic part is lost motion less clearance backlash: what is left of the lost motion once the play is taken off. In
Table 2 it is a small difference of two fitted numbers, so that a fit of the table hides what it misses of it. Each
assumption is fitted twice: to Table 2 alone, and to Table 2 and its elastic part, weighted by their limits, which shows
how near the assumption can come.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pipeline.arrays import Real
from pipeline.checks.calibrate import FittedNumber, Target, of_targets
from pipeline.checks.leastsquares import fit_numbers
from pipeline.checks.paper.assumptions import Assumption, with_elastic_plate
from pipeline.checks.paper.table2 import LARGEST_ERROR, Misfit
from pipeline.checks.response import (
    Condensed,
    SolvedCases,
    condense_disk,
    metrics_of,
    pins_in_contact,
    solve_cases,
    with_numbers,
)
from pipeline.config import Study
from pipeline.config.files.section import number_at

ELASTIC_ERROR = 0.05
"""Relative error of the elastic part, in every case, that closes the question."""
BACKLASH, LOST_MOTION = "clearance_backlash_arcmin", "lost_motion_arcmin"
ELASTIC_PART = "elastic_part_arcmin "
"""Start of the columns of the elastic part, before the case."""
TABLE, TABLE_AND_ELASTIC = "Table 2", "Table 2 and its elastic part"
UNSOLVED_MISFIT = 1e3
"""Error over its limit that stands for a trial without an equilibrium (a nearly rigid bearing): far above any other."""
AT_BOUND = 1e-3
"""Logarithmic distance from a bound up to which a number lies on it."""


def elastic_part(targets: Sequence[Target], values: Real) -> dict[str, float]:
    """Lost motion less clearance backlash [arcmin] of every case, from the ``values`` (n_targets,) of the targets."""
    published_values = {(target.case, target.metric): value for target, value in zip(targets, values, strict=True)}
    cases = dict.fromkeys(target.case for target in targets)
    return {case: float(published_values[case, LOST_MOTION] - published_values[case, BACKLASH]) for case in cases}


@dataclass(frozen=True)
class Refit:
    """A study fitted under an assumption; ``values`` (n_targets,) are its own, ``cases`` its solution."""

    fitted_to: str
    study: Study
    cases: SolvedCases
    parameters: tuple[FittedNumber, ...]
    targets: tuple[Target, ...]
    values: Real

    @property
    def error(self) -> Real:
        """Relative errors (n_targets,) of Table 2; NaN for a published zero."""
        published_values = np.array([target.value for target in self.targets])
        return (
            np.divide(
                self.values, published_values, out=np.full(len(published_values), np.nan), where=published_values != 0
            )
            - 1
        )

    @property
    def elastic_error(self) -> Real:
        """Relative errors (n_cases,) of the elastic part."""
        published_parts = elastic_part(self.targets, np.array([target.value for target in self.targets]))
        return (
            np.array(list(elastic_part(self.targets, self.values).values())) / np.array(list(published_parts.values()))
            - 1
        )

    @property
    def closes(self) -> bool:
        """Whether Table 2 is kept and the elastic part met in every case."""
        return Misfit.from_errors(self.error).largest_error <= LARGEST_ERROR and bool(
            np.max(abs(self.elastic_error)) <= ELASTIC_ERROR
        )

    @property
    def misfit(self) -> Real:
        """What the fit makes small: the errors over their limits."""
        error = self.error[np.isfinite(self.error)] / LARGEST_ERROR
        return error if self.fitted_to == TABLE else np.concatenate([error, self.elastic_error / ELASTIC_ERROR])


def refit(
    change: Assumption, disk: Condensed, targets: Sequence[Target], parameters: Sequence[FittedNumber]
) -> tuple[Refit, Refit]:
    """The fits to Table 2, and from there to Table 2 and its elastic part; ``disk`` is the declared one.

    A trial without an equilibrium counts as a misfit of ``UNSOLVED_MISFIT`` in every number.
    """
    body = condense_disk(change.study) if change.remesh else disk
    body = with_elastic_plate(change.study, body, change.plate) if change.plate else body
    free_numbers = (*parameters, *change.freed_numbers)
    keys = [parameter.key for parameter in free_numbers]
    lower, upper = (
        np.array([number.lower for number in free_numbers]),
        np.array([number.upper for number in free_numbers]),
    )

    def refit_at(fitted_to: str, numbers: Real) -> Refit:
        study = with_numbers(change.study, dict(zip(keys, numbers.tolist(), strict=True)))
        study = change.tied(study) if change.tied else study
        cases = solve_cases(study, body, change.backlash_percent)
        metrics = metrics_of(study, cases, change.backlash_percent)
        return Refit(fitted_to, study, cases, free_numbers, tuple(targets), of_targets(study, metrics, targets))

    def best_refit(fitted_to: str, start: Real) -> tuple[Refit, Real]:
        size = len(refit_at(fitted_to, start).misfit)

        def misfit(numbers: Real) -> Real:
            try:
                return refit_at(fitted_to, numbers).misfit
            except ArithmeticError:
                return np.full(size, UNSOLVED_MISFIT)

        value = fit_numbers(misfit, start, lower, upper, None).value
        return refit_at(fitted_to, value), value

    table, value = best_refit(TABLE, np.array([number_at(change.study.design, key) for key in keys]))
    return table, best_refit(TABLE_AND_ELASTIC, value)[0]


def refit_table(
    changes: Iterable[Assumption], disk: Condensed, targets: Sequence[Target], parameters: Sequence[FittedNumber]
) -> pd.DataFrame:
    """Two rows per assumption: what is fitted to, errors, elastic part, pins in contact, and the fitted numbers."""
    rows = [
        {"assumption": change.name, **_row(fit)}
        for change in changes
        for fit in refit(change, disk, targets, parameters)
    ]
    return pd.DataFrame(rows)


def _row(fit: Refit) -> Mapping[str, Any]:
    misfit = Misfit.from_errors(fit.error)
    values = {parameter.key: number_at(fit.study.design, parameter.key) for parameter in fit.parameters}
    at_bound = [
        parameter.key
        for parameter in fit.parameters
        if min(np.log(values[parameter.key] / parameter.lower), np.log(parameter.upper / values[parameter.key]))
        < AT_BOUND
    ]
    return {
        "fitted_to": fit.fitted_to,
        "largest_error": misfit.largest_error,
        "rms_error": misfit.rms,
        "compatible": misfit.met,
        **{ELASTIC_PART + case: value for case, value in elastic_part(fit.targets, fit.values).items()},
        "elastic_error": float(fit.elastic_error[-1]),
        "closes": fit.closes,
        "pins_in_contact": " ".join(str(count) for count in pins_in_contact(fit.study, fit.cases)),
        **values,
        "at_bound": " ".join(at_bound),
        **{
            f"{target.metric} {target.case}": error
            for target, error in zip(fit.targets, fit.error, strict=True)
            if target.value
        },
    }
