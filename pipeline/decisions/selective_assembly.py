"""Which measured parts to put together: predicted margins of every pair, and the best assignment.

Source of the assignment: Crouse, On implementing 2D rectangular assignment algorithms, IEEE Trans. Aerosp. Electron.
Syst. 52 (2016) 1679, as SciPy has it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import linear_sum_assignment

from pipeline.arrays import Index, Real, Truth, joined_columns
from pipeline.config.dimensions import dimension_library
from pipeline.config.distributions.shipped import Fixed
from pipeline.config.studies.study import Study
from pipeline.decisions.fresh_units import BATCH, Solve, fresh_study, preloaded_share
from pipeline.decisions.lots.lot_yield import limit_passes
from pipeline.decisions.lots.measured_lot import MeasuredLot
from pipeline.engine.parallel import batches, worker_results
from pipeline.engine.store import write_tables
from pipeline.engine.table import Column, Table
from pipeline.errors import InputError
from pipeline.model.metrics import library
from pipeline.model.metrics.turn import turn_library
from pipeline.sampling.errors import Errors, draw_with_parts
from pipeline.statistics.intervals import Estimate, pass_share

Mounting = Callable[[Errors], Real]
"""Errors of ``n`` units to the largest contact force without torque (n,) [N]."""

MOST_PAIRS = 10_000
"""Pairs that are load-solved: a hundred parts with a hundred."""
DRAWS = 10
"""Units of each assigned pair, with drawn dimensions in place of those that were not measured."""
PASS_SCORE = 1e3
"""Of a pair that keeps all limits, in margins: one more good unit is worth more than all margins."""


PAIRS = Table(
    "pairs",
    "unit of the assignment",
    (
        Column("first", "label", "", "part of the first lot"),
        Column("second", "label", "", "part of the second lot"),
        Column("margin", "float64", "1", "smallest predicted distance to a limit, as a share of it"),
        Column("passes", "bool", "", "whether the unit is predicted to meet every limit"),
        Column("mounting_force_N", "float64", "N", "largest contact force without torque; null: not asked for"),
    ),
)


@dataclass(frozen=True)
class Assembly:
    """Pairs of parts of two lots.

    Attributes
    ----------
    margin : (n_first, n_second) smallest margin over all limits, as a share of the limit; the dimensions that were not
        measured have the mean of their tolerance.
    passes : (n_first, n_second) whether a pair keeps all limits then.
    pairs : (n_pairs, 2) parts of the best assignment.
    random, selected_yield : yields of fresh units assembled at random and by the assignment.
    random_preload, selected_preload : shares of these units that are preloaded at some crank angle.
    mounting_N : (n_first, n_second) largest contact force without torque [N]; None where no limit was stated.
    """

    first_lot: MeasuredLot
    second_lot: MeasuredLot
    margin: Real
    passes: Truth
    pairs: Index
    random: Estimate
    selected_yield: Estimate
    random_preload: float
    selected_preload: float
    mounting_N: Real | None

    def binding_share(self, limit_N: float) -> float:
        """Share of all pairs whose contacts are pressed by more than a force [N] without torque."""
        assert self.mounting_N is not None
        return float(np.mean(~(self.mounting_N <= limit_N)))


def best_assembly(
    study: Study,
    first_lot: MeasuredLot,
    second_lot: MeasuredLot,
    solve: Solve,
    jobs: int,
    mounting: Mounting | None = None,
) -> Assembly:
    """The best assignment of the parts of one lot to those of another.

    Parameters
    ----------
    solve : of the study.
    mounting : contact forces without torque, where a limit of them is asked for.

    Raises
    ------
    InputError
        If the lots have a dimension in common or parts without a value, there are too many pairs, or the study has no
        limits.
    """
    common = sorted(set(first_lot.values) & set(second_lot.values))
    if common:
        raise InputError(
            f"{first_lot.name} and {second_lot.name} both have {', '.join(common)}; a unit has one of each"
        )
    if not study.limits.of_metrics:
        raise InputError(f"study {study.name}: [limits] is empty; a margin needs a limit")
    n_first, n_second = len(first_lot.parts), len(second_lot.parts)
    if n_first * n_second > MOST_PAIRS:
        raise InputError(f"{n_first} x {n_second} parts; at most {MOST_PAIRS:,} pairs are solved; split the lots")
    _check_complete(first_lot)
    _check_complete(second_lot)
    rows, columns = (index.ravel() for index in np.indices((n_first, n_second)))
    mean_study = _unmeasured_at_mean(study, {*first_lot.values, *second_lot.values})
    measured_values = _measured_values(first_lot, rows) | _measured_values(second_lot, columns)
    values = _solve_metrics(mean_study, measured_values, solve, jobs)
    margin = _margins(study, values).reshape(n_first, n_second)
    passes = limit_passes(study, values).reshape(n_first, n_second)
    score = PASS_SCORE * passes + np.clip(np.nan_to_num(margin, nan=-1.0), -1.0, 1.0)
    pairs = np.stack(linear_sum_assignment(score, maximize=True), axis=1)
    rng = np.random.default_rng(study.samples.seed)
    chosen_pairs = np.repeat(pairs, DRAWS, axis=0)
    units_of_pairs = rng.integers((n_first, n_second), size=chosen_pairs.shape), chosen_pairs
    shares = [_verified_yield(study, first_lot, second_lot, units, solve, jobs) for units in units_of_pairs]
    forces = None
    if mounting is not None:
        forces = mounting(_errors(mean_study, measured_values, 0, len(rows))).reshape(n_first, n_second)
    return Assembly(
        first_lot=first_lot,
        second_lot=second_lot,
        margin=margin,
        passes=passes,
        pairs=pairs,
        random=shares[0][0],
        selected_yield=shares[1][0],
        random_preload=shares[0][1],
        selected_preload=shares[1][1],
        mounting_N=forces,
    )


def _check_complete(lot: MeasuredLot) -> None:
    for name, values in lot.values.items():
        missing = np.flatnonzero(~np.all(np.isfinite(values), axis=1))
        if len(missing):
            raise InputError(f"{lot.name}: part {lot.parts[missing[0]]} has no {name}; measure it or delete the part")


def _measured_values(lot: MeasuredLot, rows: Index) -> dict[str, Real]:
    return {name: values[rows] for name, values in lot.values.items()}


def _unmeasured_at_mean(study: Study, measured_names: set[str]) -> Study:
    """The study whose dimensions that were not measured have the mean of their tolerance."""
    means = {
        name: Fixed(distribution="fixed", allowance_um=tolerance.allowance_um, value_um=tolerance.average_um)
        for name, tolerance in study.tolerances
        if name not in measured_names and tolerance.varies and not dimension_library()[name].direction
    }
    return study.with_section("tolerances", **means)


def _errors(study: Study, measured_values: Mapping[str, Real], start: int, stop: int) -> Errors:
    parts = {name: part[start:stop] for name, part in measured_values.items()}
    return draw_with_parts(fresh_study(study, max(stop, 1)), parts, start, stop)


def _solve_metrics(study: Study, measured_values: Mapping[str, Real], solve: Solve, jobs: int) -> dict[str, Real]:
    """Each metric over the turn (n,) of units with these parts."""
    n = len(next(iter(measured_values.values())))
    inputs = ((_errors(study, measured_values, *ends),) for ends in batches(0, n, BATCH))
    return joined_columns([of_turn for _, of_turn in worker_results(jobs, solve, inputs)])


def _margins(study: Study, values: Mapping[str, Real]) -> Real:
    """Smallest distance (n,) to a limit, as a share of it; negative beyond a limit."""
    metrics = {**library(), **turn_library()}
    margins = []
    for name, limit in study.limits.of_metrics.items():
        if name in values:
            distance = np.asarray(values[name]) - limit
            margins.append((distance if metrics[name].smaller_is_worse else -distance) / limit)
    smallest: Real = np.min(margins, axis=0)
    return smallest


def _verified_yield(
    study: Study, first_lot: MeasuredLot, second_lot: MeasuredLot, pairs: Index, solve: Solve, jobs: int
) -> tuple[Estimate, float]:
    """Yield of a fresh unit of each pair (n_units, 2) of parts, and the share of these units that is preloaded."""
    values = _solve_metrics(
        study, _measured_values(first_lot, pairs[:, 0]) | _measured_values(second_lot, pairs[:, 1]), solve, jobs
    )
    return pass_share(limit_passes(study, values), study.metrics.confidence), preloaded_share(values)


def pair_rows(assembly: Assembly) -> pd.DataFrame:
    """Rows of `PAIRS`, the smallest margin first."""
    rows, columns = assembly.pairs.T
    forces = np.full(len(rows), np.nan) if assembly.mounting_N is None else assembly.mounting_N[rows, columns]
    frame = pd.DataFrame(
        {
            "first": [assembly.first_lot.parts[k] for k in rows],
            "second": [assembly.second_lot.parts[k] for k in columns],
            "margin": assembly.margin[rows, columns],
            "passes": assembly.passes[rows, columns],
            "mounting_force_N": forces,
        }
    )
    return frame.sort_values("margin", kind="stable").reset_index(drop=True)


def write_pairs(assembly: Assembly, folder: Path) -> dict[str, pd.DataFrame]:
    """Write the table of pairs as CSV and Parquet into ``folder``; its frame by its name."""
    return write_tables({PAIRS: pair_rows(assembly)}, folder, as_csv=True)
