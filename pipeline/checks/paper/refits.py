"""Fits of Table 2 under one changed assumption, and how near its elastic part then comes to the published one.

The elastic part is lost motion less clearance backlash: what is left of the lost motion once the play is taken off. In
Table 2 it is a small difference of two fitted numbers, so that a fit of the table hides what it misses of it. Each
assumption is fitted twice: to Table 2 alone, and to Table 2 and its elastic part, weighted by their limits, which shows
how near the assumption can come.

What the agreement with Table 2 hides: the elastic part, a straight line that does as well, and the choices.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pipeline import assembly
from pipeline.arrays import Real
from pipeline.checks import response
from pipeline.checks.calibrate import FittedNumber, Target, of_targets
from pipeline.checks.paper.assumptions import Assumption, with_elastic_plate
from pipeline.checks.paper.statements import bearing_deflections
from pipeline.checks.paper.table2 import LARGEST_ERROR, Misfit, Tables
from pipeline.config import Study
from pipeline.config.files.section import number_at
from pipeline.model.geometry.clearance import gaps
from pipeline.model.geometry.rigid_play.rigid_backlash import separated_play
from pipeline.model.load_history.load_cycle import ARCMIN
from pipeline.sampling.errors import draw

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
    cases: response.SolvedCases
    parameters: tuple[FittedNumber, ...]
    targets: tuple[Target, ...]
    values: Real

    @property
    def error(self) -> Real:
        """Relative errors (n_targets,) of Table 2; NaN for a published zero."""
        published_values = np.array([target.value for target in self.targets])
        is_published, no_ratio = published_values != 0, np.full(len(published_values), np.nan)
        relative_error: Real = np.divide(self.values, published_values, out=no_ratio, where=is_published) - 1
        return relative_error

    @property
    def elastic_error(self) -> Real:
        """Relative errors (n_cases,) of the elastic part."""
        published_parts = elastic_part(self.targets, np.array([target.value for target in self.targets]))
        relative_error: Real = (
            np.array(list(elastic_part(self.targets, self.values).values())) / np.array(list(published_parts.values()))
            - 1
        )
        return relative_error

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
    change: Assumption, disk: response.Condensed, targets: Sequence[Target], parameters: Sequence[FittedNumber]
) -> tuple[Refit, Refit]:
    """The fits to Table 2, and from there to Table 2 and its elastic part; ``disk`` is the declared one.

    A trial without an equilibrium counts as a misfit of ``UNSOLVED_MISFIT`` in every number.
    """
    body = response.condense_disk(change.study) if change.remesh else disk
    body = with_elastic_plate(change.study, body, change.plate) if change.plate else body
    free_numbers = (*parameters, *change.freed_numbers)
    keys = [parameter.key for parameter in free_numbers]
    lower = np.array([number.lower for number in free_numbers])
    upper = np.array([number.upper for number in free_numbers])

    def refit_at(fitted_to: str, numbers: Real) -> Refit:
        study = response.with_numbers(change.study, dict(zip(keys, numbers.tolist(), strict=True)))
        study = change.tied(study) if change.tied else study
        cases = response.solve_cases(study, body, change.backlash_percent)
        metrics = response.metrics_of(study, cases, change.backlash_percent)
        return Refit(fitted_to, study, cases, free_numbers, tuple(targets), of_targets(study, metrics, targets))

    def best_refit(fitted_to: str, start: Real) -> tuple[Refit, Real]:
        size = len(refit_at(fitted_to, start).misfit)

        def misfit(numbers: Real) -> Real:
            try:
                return refit_at(fitted_to, numbers).misfit
            except ArithmeticError:
                return np.full(size, UNSOLVED_MISFIT)

        value = response.fit_numbers(misfit, start, lower, upper, None).value
        return refit_at(fitted_to, value), value

    table, value = best_refit(TABLE, np.array([number_at(change.study.design, key) for key in keys]))
    return table, best_refit(TABLE_AND_ELASTIC, value)[0]


def refit_table(
    changes: Iterable[Assumption],
    disk: response.Condensed,
    targets: Sequence[Target],
    parameters: Sequence[FittedNumber],
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
        "pins_in_contact": " ".join(str(count) for count in response.pins_in_contact(fit.study, fit.cases)),
        **values,
        "at_bound": " ".join(at_bound),
        **{
            f"{target.metric} {target.case}": error
            for target, error in zip(fit.targets, fit.error, strict=True)
            if target.value
        },
    }


RIGIDITY = "torsional_rigidity_Nm_per_arcmin"
STUDY_CHOICES = ("metrics.rigidity_percent", "clearance.disk_reading", "clearance.roller_reading")
"""Settings of the study that were picked with Table 2 in sight, as its file says."""
FITTED_PART, CHOSEN_PART = "fitted", "chosen in sight"
MODEL, GEOMETRY = "the model, fitted to the columns before", "geometry, and straight lines in D"
IN_DISK, IN_ROLLER = "straight lines in D", "straight lines in R"
"""What predicts the last column from the two before it. ``GEOMETRY`` takes D's share of the backlash from the geometry,
which nothing is fitted to, R's share in proportion to R, and the elastic part and the rigidity on a line in D."""


@dataclass(frozen=True)
class Shortfalls:
    """What the page says beside the agreement.

    Attributes
    ----------
    elastic_part : per case published, computed [arcmin] and relative error.
    predictions : per predictor and metric the last column's value and relative error.
    choices : key of every number that Table 2 had a part in, and how: fitted, or chosen in its sight.
    targets : numbers of Table 2 that are not zero.
    bearing : per torque [N m] its deflection [um] in the order of the cases, smallest tolerance first.
    """

    elastic_part: pd.DataFrame
    predictions: pd.DataFrame
    choices: pd.DataFrame
    targets: int
    bearing: pd.DataFrame

    @property
    def largest_errors(self) -> pd.Series:
        """Largest relative error of each predictor, by its name."""
        return self.predictions.groupby("predictor", sort=False)["relative_error"].agg(
            lambda errors: errors.abs().max()
        )


def shortfalls(
    study: Study,
    targets: Sequence[Target],
    parameters: Sequence[FittedNumber],
    table: pd.DataFrame,
    predicted_table: pd.DataFrame,
    tables: Tables,
) -> Shortfalls:
    """From the run's Table 2, the prediction of its last column, and its tables.

    Parameters
    ----------
    table, predicted_table : as of ``table2.table2`` and ``table2.prediction``, in the order of the targets.
    """
    return Shortfalls(
        elastic_parts(targets, table["computed"].to_numpy(float)),
        predictions(study, targets, predicted_table),
        choices(study, parameters),
        sum(target.value != 0 for target in targets),
        _bearing(tables),
    )


def elastic_parts(targets: Sequence[Target], values: Real) -> pd.DataFrame:
    """Published and computed elastic part of every case [arcmin]."""
    published_parts = elastic_part(targets, np.array([target.value for target in targets]))
    rows = [(case, value, elastic_part(targets, values)[case]) for case, value in published_parts.items()]
    frame = pd.DataFrame(rows, columns=["case", "published", "computed"])
    return frame.assign(relative_error=frame["computed"] / frame["published"] - 1)


def predictions(study: Study, targets: Sequence[Target], predicted_table: pd.DataFrame) -> pd.DataFrame:
    """The last column of Table 2 by the model and by straight lines through the two columns before it."""
    columns: dict[str, dict[str, float]] = {}
    for target in targets:
        columns.setdefault(target.case, {})[target.metric] = target.value
    fitted_columns, middle, published_column = columns.values()
    sizes = {target.case: (target.tolerance_disk_um, target.tolerance_roller_um) for target in targets}
    _, of_middle, of_last = sizes.values()
    disk, roller = (end / start for start, end in zip(of_middle, of_last, strict=True))
    lines = {
        GEOMETRY: _with_geometry(study, fitted_columns, middle, disk, roller),
        IN_DISK: _line(fitted_columns, middle, disk),
        IN_ROLLER: _line(fitted_columns, middle, roller),
    }
    values = {MODEL: dict(zip(predicted_table["metric"], predicted_table["computed"], strict=True)), **lines}
    rows = [
        {"predictor": name, "metric": metric, "published": published_column[metric], "value": value[metric]}
        for name, value in values.items()
        for metric in published_column
    ]
    frame = pd.DataFrame(rows)
    return frame.assign(relative_error=frame["value"] / frame["published"] - 1)


def _line(fitted_columns: dict[str, float], middle: dict[str, float], reach: float) -> dict[str, float]:
    """The straight line from a column without tolerance through the next one, at ``reach`` times its tolerance."""
    return {
        metric: fitted_columns[metric] + reach * (middle[metric] - fitted_columns[metric]) for metric in fitted_columns
    }


def _with_geometry(
    study: Study, fitted_columns: dict[str, float], middle: dict[str, float], disk: float, roller: float
) -> dict[str, float]:
    """See ``GEOMETRY``; ``disk`` and ``roller`` are the tolerances of the last column over those of the middle one."""
    _, of_disk, of_disk_last = disk_backlash(study)
    backlash = of_disk_last + roller * (middle[BACKLASH] - of_disk)
    line = _line(fitted_columns, middle, disk)
    return {BACKLASH: backlash, LOST_MOTION: backlash + line[LOST_MOTION] - line[BACKLASH], RIGIDITY: line[RIGIDITY]}


def disk_backlash(study: Study) -> Real:
    """Backlash (n_cases,) [arcmin] of the cases with the error of the disk alone: geometry, nothing fitted."""
    reduced_study = tuple(case.model_copy(update={"roller_diameter": 0.0}) for case in study.cases)
    cases = study.model_copy(update={"cases": reduced_study})
    reducer = assembly.reducer(study.design, study.cycle.crank_deg[0])
    errors = assembly.errors(draw(cases, 0, cases.samples.rows))
    play = separated_play(reducer, gaps(assembly.profile(study.design), reducer, errors, **dict(study.clearance)))
    return ARCMIN * (play.pose_plus - play.pose_minus)[:, reducer.output_motion]


def choices(study: Study, parameters: Sequence[FittedNumber]) -> pd.DataFrame:
    """Every number of the design and setting of the study that Table 2 had a part in."""
    fitted_keys = [parameter.key for parameter in parameters]
    in_sight = [
        key
        for key, origin in study.design.provenance.items()
        if key not in fitted_keys and (origin.status == "calibrated" or origin.in_sight_of)
    ]
    keys = [*fitted_keys, *in_sight, *STUDY_CHOICES]
    return pd.DataFrame({"key": keys, "part": [FITTED_PART if key in fitted_keys else CHOSEN_PART for key in keys]})


def _bearing(tables: Tables) -> pd.DataFrame:
    rated_torque = tables.study.design.cycloid.rated_torque_Nm
    labels = [case.label for case in tables.study.cases]
    rows = [
        {"torque_Nm": torque, **dict(zip(labels, bearing_deflections(tables, torque), strict=True))}
        for torque in (tables.lost_motion_torque, rated_torque)
    ]
    return pd.DataFrame(rows)
