"""Distributions and yields: of each crank angle, over the turn of each unit, and of the whole turn.

The columns of all samples at each crank angle are kept in a file: a million samples at 31 angles would take 1.5 GB.
"""

from collections.abc import Mapping, Sequence
from typing import IO

import numpy as np
import pandas as pd

from pipeline.config.studies.study import ALL_LIMITS, Study
from pipeline.engine.table import Column, Columns, Table, interval_columns
from pipeline.model.metrics import library
from pipeline.model.metrics.turn import turn_library
from pipeline.sampling.designs import replicates
from pipeline.statistics.intervals import Estimate, distribution, pass_share, with_missing
from stages.tables.convergence import angles_of_turn, searched_pitches
from stages.tables.turn import TURN_VALUES, whole_turn_estimates
from stages.worst import RANGES

OVER_ALL = "turn"
"""What a metric of the whole turn is over."""
DISTRIBUTIONS = Table(
    "distributions",
    "metric, crank or turn, statistic",
    (
        Column("metric", "label", "", "column of metrics; all_limits: the yield against all limits together"),
        Column(
            "over",
            "label",
            "",
            "angle: at one crank angle; worst, mean or best: of each unit over the turn, as in the table units; turn: "
            "metric of the turn; whole_turn: the worst over the whole turn of the output, corrected by the audited "
            "units, with an interval for the sampling and the search together; continuous_turn: bound in the mean of "
            "the same over all angles between, from what finer angles add to the audited units",
        ),
        Column("crank_deg", "float64", "deg", "crank angle; null but for over = angle"),
        Column("statistic", "label", "", "mean, std, quantile, or yield: the share within the limit"),
        Column("value", "float64", "the metric's", "estimate"),
        *interval_columns("the metric's"),
        Column("n", "int32", "1", "samples that it rests on"),
        Column("n_angles", "int32", "1", "crank angles that each sample's value rests on"),
    ),
)


class PerAngle:
    """Numbers of samples at crank angles that come block by block and are read angle by angle.

    Parameters
    ----------
    file : open for writing and reading, on a disk that has room for them.
    names : of the columns.
    n_angles : rows of a sample, one after the other.
    """

    def __init__(self, file: IO[bytes], names: Sequence[str], n_angles: int) -> None:
        self._file, self._names, self._n_angles = file, tuple(names), n_angles
        self._counts: list[int] = []

    def add(self, columns: Mapping[str, np.ndarray]) -> None:
        """Add columns (n_samples n_angles,) of further samples."""
        block = np.stack([np.asarray(columns[name], float).reshape(-1, self._n_angles).T for name in self._names], 1)
        self._file.write(np.ascontiguousarray(block).data)
        self._counts.append(block.shape[2])

    def columns_at(self, angle: int) -> dict[str, np.ndarray]:
        """Columns (n_samples,) at the angle of a number, as floats."""
        parts, start = [], 0
        for count in self._counts:
            size = len(self._names) * count
            self._file.seek(8 * (start + angle * size))
            parts.append(np.frombuffer(self._file.read(8 * size)).reshape(len(self._names), count))
            start += self._n_angles * size
        return dict(zip(self._names, np.concatenate(parts, axis=1), strict=True))


def _part(replicate: np.ndarray | None, rows: np.ndarray) -> np.ndarray | None:
    return None if replicate is None else replicate[rows]


def _rows(
    study: Study, values: pd.DataFrame, turn_value: str, crank_deg: float, angles: Mapping[str, int], n_units: int
) -> list[dict[str, object]]:
    """Rows of the distributions of one population, indexed by sample; ``angles`` behind each metric that is told.

    Of ``n_units`` units those without a value count in the lower end of a yield as if they failed.
    """
    confidence, replicate = study.metrics.confidence, replicates(study.samples, values.index.to_numpy())
    estimates: list[tuple[str, str, Estimate]] = []
    for metric in angles:
        holding = ~np.isnan(values[metric].to_numpy(float))
        if holding.any():
            statistics = distribution(values[metric].to_numpy()[holding], confidence, _part(replicate, holding))
            estimates += [(metric, name, estimate) for name, estimate in statistics.items()]
    for name, passes in study.limits.pass_flags(values).items():
        limited_metrics = study.limits.limited_metrics(name, values)
        if name not in angles and (name != ALL_LIMITS or turn_value == OVER_ALL):
            continue
        holding = ~np.isnan(values[limited_metrics].to_numpy(float)).any(axis=1)
        if holding.any():
            known, n_missing = _part(replicate, holding), n_units - int(np.count_nonzero(holding))
            estimates.append((name, "yield", pass_share(passes[holding], confidence, known, n_missing)))
    if len(values) and turn_value in ("angle", TURN_VALUES[0]):
        estimates.append(("preloaded", "mean", pass_share(values["preloaded"].to_numpy(bool), confidence, replicate)))
    fewest = min(angles.values())
    counts = {"preloaded": max(angles.values()), **angles}  # of rigid bodies, as the backlash
    return [
        {
            "metric": metric,
            "over": turn_value,
            "crank_deg": crank_deg,
            "statistic": name,
            **vars(estimate),
            "n_angles": counts.get(metric, fewest),
        }
        for metric, name, estimate in estimates
    ]


def over_turn(units: pd.DataFrame, turn_value: str) -> pd.DataFrame:
    """The metrics of the units that have a result, (n, n_metrics) by sample, as `worst`, `mean` or `best`.

    Those of the whole turn stand beside them. A metric that does not hold at some crank angle is missing.
    """
    metric_columns = {f"{name}_{turn_value}": name for name in library()}
    needed_units = units[["sample", *metric_columns, *turn_library(), "preloaded"]]  # of a million units few columns
    is_solved = needed_units[list(metric_columns)].notna().any(axis=1)
    return needed_units[is_solved].set_index("sample").rename(columns=metric_columns)


def distribution_rows(
    study: Study, per_angle: PerAngle, units: pd.DataFrame, shortfalls: Mapping[str, pd.DataFrame]
) -> Columns:
    """Rows of the table of distributions: of each crank angle, over the turn, of the turn and of the whole turn.

    Parameters
    ----------
    per_angle : the metrics at each crank angle, nominal reducer and all.
    units : the table of units without the nominal reducer.
    shortfalls : of the audited units from the worst over the whole turn, by what that is over.
    """
    rows = []
    for turn_value, shortfall in shortfalls.items():
        for metric, name, estimate in whole_turn_estimates(study, over_turn(units, "worst"), shortfall):
            estimate = with_missing(estimate, len(units) - estimate.n) if name == "yield" else estimate
            keys = {"metric": metric, "over": turn_value, "crank_deg": np.nan, "statistic": name}
            rows.append({**keys, **vars(estimate), "n_angles": searched_pitches(study)})
    single = dict.fromkeys(library(), 1)
    for angle in np.argsort(study.cycle.crank_deg):
        part = pd.DataFrame(per_angle.columns_at(int(angle))).iloc[int(study.samples.nominal_first) :]
        solved_units = part[part[list(library())].notna().any(axis=1)]
        if len(solved_units):
            rows += _rows(study, solved_units, "angle", float(study.cycle.crank_deg[angle]), single, len(part))
    if len(units):
        counts = units.iloc[0]
        turn = {
            name: int(counts["n_rigid_angles" if metric.turn_of_rigid_bodies else "n_angles"])
            for name, metric in library().items()
        }
        for turn_value in TURN_VALUES:
            n_searched = searched_pitches(study) if turn_value == "worst" else 0
            counts_of_turn = {name: max(count, n_searched) for name, count in turn.items()}
            rows += _rows(study, over_turn(units, turn_value), turn_value, np.nan, counts_of_turn, len(units))
        of_turn = {name: angles_of_turn(study, 1, metric.of_play) for name, metric in turn_library().items()}
        of_turn |= {name: max(of_turn[name], searched_pitches(study)) for name in RANGES}
        rows += _rows(study, over_turn(units, TURN_VALUES[0]), OVER_ALL, np.nan, of_turn, len(units))
    return DISTRIBUTIONS.columns_of_rows(rows)
