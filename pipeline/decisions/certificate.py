"""The certificate of one unit: what it will do, as far as its dimensions were measured, and a compensation table.

The dimensions that were not measured are drawn from the tolerances, so that every number has a band: the 95 % of the
units that the measured one may be. Bounds hold for all of them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arrays import Index, Real, Truth
from pipeline.config.dimensions import dimension_library
from pipeline.config.studies.study import Study
from pipeline.config.studies.tolerances import Case, GaugedCase, direction_key
from pipeline.decisions.box import Box
from pipeline.decisions.fresh_units import Solve, fresh_study, preloaded_share
from pipeline.decisions.lots.lot_yield import limit_passes
from pipeline.decisions.play_bounds import Bound, play_bounds
from pipeline.engine.store import write_csv, write_json, write_tables
from pipeline.engine.table import Column, Table
from pipeline.errors import InputError
from pipeline.model.metrics import Limited, library
from pipeline.model.metrics.turn import turn_library
from pipeline.sampling.errors import Errors, draw_with_parts
from pipeline.statistics.intervals import Estimate, pass_share

BAND = (0.025, 0.975)
"""Quantiles of the drawn units between which a band lies."""
DRAWS = 200
"""Units that the measured one may be: a band's end is known to about a tenth of its width."""
ALWAYS_VALUED = "torsional_rigidity_Nm_per_arcmin"
"""Metric that each unit has for which the model is valid."""

METRICS_TABLE = Table(
    "metrics",
    "metric",
    (
        Column("metric", "label", "", "column of metrics, over the turn as its limit means it"),
        Column("median", "float64", "the metric's", "of the units that the measured one may be"),
        Column("low", "float64", "the metric's", "lower end of the 95 % band"),
        Column("high", "float64", "the metric's", "upper end of the 95 % band"),
        Column("limit", "float64", "the metric's", "of the study; null: none"),
        Column("probability", "float64", "1", "that the unit meets the limit; null: no limit"),
    ),
)
COMPENSATION = Table(
    "compensation",
    "crank angle, sense, torque",
    (
        Column("crank_deg", "float64", "deg", "crank angle"),
        Column("sense", "label", "", "rising or falling torque"),
        Column("torque_Nm", "float64", "N m", "torque on the output"),
        Column("error_arcmin", "float64", "arcmin", "output angle less the nominal one: subtract it from the command"),
        Column("low_arcmin", "float64", "arcmin", "lower end of the 95 % band"),
        Column("high_arcmin", "float64", "arcmin", "upper end of the 95 % band"),
    ),
)


@dataclass(frozen=True)
class Loops:
    """Loops of ``n`` units at crank angles (n_cranks,) [deg], as functions of the torque.

    Attributes
    ----------
    torque : (n_torques,) [N m] ascending, without zero.
    angle : (n, n_cranks, 2, n_torques) [arcmin] of the output, with rising and with falling torque.
    """

    crank_deg: Real
    torque: Real
    angle: Real


@dataclass(frozen=True)
class Certificate:
    """What is known of one unit.

    Attributes
    ----------
    label : of the unit.
    measured_um : total deviations of the measured dimensions (1, n_elements).
    measured_to_um : standard uncertainty of these; 0 leaves it out.
    is_determined : whether nothing was left to draw, so that the numbers are those of one unit.
    metrics : rows of `METRICS_TABLE`.
    meets_all : probability that the unit meets every limit, with the interval of the number of draws, of a determined
        unit 0 or 1; None without limits.
    preloaded : share of the units that the measured one may be whose parts interfere without load.
    bounds : of the rigid play at the first crank angle, over all that was not measured.
    why_no_bounds : empty where there are bounds.
    loops : of the units that the measured one may be and for which the model is valid; missing if there is none.
    """

    study: Study
    label: str
    measured_um: Mapping[str, Real]
    measured_to_um: float
    is_determined: bool
    metrics: pd.DataFrame
    meets_all: Estimate | None
    preloaded: float
    bounds: tuple[Bound, ...]
    why_no_bounds: str
    loops: Loops

    @property
    def measured_dimensions(self) -> tuple[str, ...]:
        """Names of the measured dimensions."""
        return tuple(self.measured_um)

    @property
    def is_predicted(self) -> bool:
        """Whether the model is valid for any of the units that the measured one may be."""
        return bool(np.isfinite(self.loops.angle).any())

    @property
    def compensation(self) -> pd.DataFrame:
        """Rows of `COMPENSATION`."""
        low, high = np.quantile(self.loops.angle, BAND, axis=0)
        axes = np.meshgrid(self.loops.crank_deg, ["rising", "falling"], self.loops.torque, indexing="ij")
        values = (*axes, np.median(self.loops.angle, axis=0), low, high)
        names = COMPENSATION.schema.names
        return pd.DataFrame({name: np.ravel(value) for name, value in zip(names, values, strict=True)})

    def predicted_angle(self, crank_deg: Real, rising: Truth, torque: Real) -> Real:
        """Angle error (n,) [arcmin] that the compensation table holds, interpolated; missing beyond its range.

        It is linear between two crank angles and between two torques of one sign. Nearer to zero torque, where the
        output passes its play, it is that of the smallest torque of the same sign.
        """
        loops, table = self.loops, np.median(self.loops.angle, axis=0)
        result = np.full(len(torque), np.nan)
        for crank in np.unique(crank_deg):
            lower, upper, share = _neighbours(loops.crank_deg, float(crank))
            for sense, in_sense in ((0, rising), (1, ~rising)):
                levels = (1 - share) * table[lower, sense] + share * table[upper, sense]
                for sign in (-1, 1):
                    side = np.sign(loops.torque) == sign
                    rows = np.flatnonzero((crank_deg == crank) & in_sense & (np.sign(torque) == sign))
                    rows = rows[np.abs(torque[rows]) <= np.abs(loops.torque[side]).max() * (1 + 1e-9)]
                    result[rows] = np.interp(torque[rows], loops.torque[side], levels[side])
        return result


def _neighbours(cranks: Real, crank: float) -> tuple[int, int, float]:
    """Numbers of the crank angles beside one, and its place between them; the share is missing beyond all of them."""
    exact = np.flatnonzero(np.isclose(cranks, crank, rtol=0, atol=1e-6))
    if len(exact):
        return int(exact[0]), int(exact[0]), 0.0
    upper = int(np.searchsorted(cranks, crank))
    if upper in (0, len(cranks)):
        return 0, 0, np.nan
    return upper - 1, upper, float((crank - cranks[upper - 1]) / (cranks[upper] - cranks[upper - 1]))


def measured_values(case: Case) -> dict[str, Real]:
    """Total deviations [um] of the dimensions that a unit's file states, and directions [rad], (1, n_elements) each."""
    values: dict[str, Real] = {}
    for name, dimension in sorted(dimension_library().items()):
        if name in case.model_fields_set:
            values[name] = np.atleast_1d(np.asarray(case.deviation_um(name), float))[None]
        if direction_key(name) in case.model_fields_set:
            values[dimension.phase] = np.atleast_1d(case.direction_rad(name))[None]
    return values


def gauged_values(values: Mapping[str, Real], measured_to_um: float, draws: int, seed: int) -> dict[str, Real]:
    """What measured dimensions may be in truth (draws, n_elements), as `measured_values` has what was read.

    The error of the gauge is normal: one that all elements of a dimension share and one of each alone. A run-out or
    position has them in both of its coordinates, and an amplitude is never negative.
    """
    rng, gauged = np.random.default_rng(seed), dict(values)

    def spread(read: Real) -> Real:
        common = rng.standard_normal((draws, 1))
        own = rng.standard_normal((draws, read.shape[1])) if read.shape[1] > 1 else 0.0
        return np.asarray(read + measured_to_um * (common + own))

    for name, dimension in dimension_library().items():
        if name not in values:
            continue
        if dimension.direction:
            vector = values[name] * np.exp(1j * values.get(dimension.phase, np.zeros((1, 1))))
            vector = spread(vector.real) + 1j * spread(vector.imag)
            directions = {dimension.phase: np.angle(vector)} if dimension.phase in values else {}
            gauged |= {name: np.abs(vector), **directions}
        else:
            gauged[name] = np.maximum(spread(values[name]), 0.0 if dimension.one_sided else -np.inf)
    return gauged


def certificate(
    study: Study, case: GaugedCase, solve: Solve, solve_loops: Callable[[Errors], Loops], draws: int = DRAWS
) -> Certificate:
    """The certificate of the unit whose measured dimensions a case states.

    Parameters
    ----------
    study : whose tolerances the dimensions have that were not measured.
    solve : metrics of units over the turn.
    solve_loops : whole loops of units.

    Raises
    ------
    InputError
        If the study lists cases.
    """
    if study.samples.experiment == "cases":
        raise InputError(f"study {study.name}: listed cases have no tolerances; give a study with tolerances")
    known_values = measured_values(case)
    is_determined = not case.measured_to_um and _are_alike(draw_with_parts(fresh_study(study, 2), known_values, 0, 2))
    draws = 1 if is_determined else draws
    unit_values = dict(known_values)
    if case.measured_to_um:
        unit_values = gauged_values(known_values, case.measured_to_um, draws, study.samples.seed)
    units = draw_with_parts(fresh_study(study, draws), unit_values, 0, draws)
    values = solve(units)[1]
    loops = _valid_loops(solve_loops(units), np.isfinite(values[ALWAYS_VALUED]))
    meets_all = None
    if study.limits.of_metrics:
        passes = limit_passes(study, values)
        share = float(np.mean(passes))
        meets_all = Estimate(share, share, share, 1) if is_determined else pass_share(passes, study.metrics.confidence)
    metrics, bounds = _metrics(study, values), _bounds(study, known_values, loops)
    measured_um = {name: known for name, known in known_values.items() if name in dimension_library()}
    return Certificate(
        study=study,
        label=case.label,
        measured_um=measured_um,
        measured_to_um=case.measured_to_um,
        is_determined=is_determined,
        metrics=metrics,
        meets_all=meets_all,
        preloaded=preloaded_share(values),
        bounds=bounds[0],
        why_no_bounds=bounds[1],
        loops=loops,
    )


def _are_alike(units: Errors) -> bool:
    """Whether no error differs from unit to unit; a direction without an amplitude is none."""
    values = dict(vars(units))
    for dimension in dimension_library().values():
        if dimension.direction:
            values[dimension.phase] = values[dimension.field] * np.exp(1j * values[dimension.phase])
    return not any(np.any(rows != rows[:1]) for rows in values.values())


def _valid_loops(loops: Loops, is_valid: Truth) -> Loops:
    """The loops of the units for which the model is valid (n,); a loop of missing values if there is none."""
    missing = np.full((1, *loops.angle.shape[1:]), np.nan)
    return replace(loops, angle=loops.angle[is_valid] if is_valid.any() else missing)


def _metrics(study: Study, values: Mapping[str, Real]) -> pd.DataFrame:
    limits, pass_flags = study.limits.of_metrics, study.limits.pass_flags(values)
    rows = []
    metrics = {**library(), **turn_library()}
    for name in (name for name in metrics if name in values):
        finite = values[name][np.isfinite(values[name])]
        if len(finite):
            low, high = np.quantile(finite, BAND)
            share = float(np.mean(pass_flags[name])) if name in limits else np.nan
            rows.append((name, float(np.median(finite)), low, high, limits.get(name, np.nan), share))
    return METRICS_TABLE.frame(rows)


def _bounds(study: Study, known_values: Mapping[str, Real], loops: Loops) -> tuple[tuple[Bound, ...], str]:
    """Bounds of the rigid play at the first crank angle, and why there are none."""
    rigid = [name for name, metric in library().items() if metric.turn_of_rigid_bodies]
    try:
        box = Box.from_study(study, known_values)
    except InputError:
        return (), "Every dimension that varies was measured: nothing else gives the play a range."
    try:
        return tuple(bound for name in rigid for bound in play_bounds(box, float(loops.crank_deg[0]), name)), ""
    except ArithmeticError:
        return (), "The play has no bounds: with the measured dimensions the rigid parts jam at this crank angle."


@dataclass(frozen=True)
class Compensated:
    """A measured loop before and after compensation, about each position's own mean.

    Attributes
    ----------
    before_arcmin, after_arcmin : rms of the measured angles, and of what the table leaves.
    rows : that lie within the table's torques.
    """

    before_arcmin: float
    after_arcmin: float
    rows: int


def compensation(
    unit: Certificate, crank_deg: Real, rising: Truth, torque: Real, angle: Real, position: Index
) -> Compensated:
    """What the compensation table leaves of measured rows (n,).

    Parameters
    ----------
    crank_deg, torque, angle : [deg], [N m], [arcmin].
    rising : whether the torque rises.
    position : number of the crank position of each row, each with an angle offset of its own.

    Raises
    ------
    InputError
        If no row lies within the torques of the table.
    """
    remainder = angle - unit.predicted_angle(crank_deg, rising, torque)
    rows = np.isfinite(remainder)
    if not rows.any():
        raise InputError(f"{unit.label}: no measured row lies within the torques of the compensation table")
    parts = [_centred_values(values[rows], position[rows]) for values in (angle, remainder)]
    rms_before, rms_after = (float(np.sqrt(np.mean(part**2))) for part in parts)
    return Compensated(rms_before, rms_after, int(rows.sum()))


def _centred_values(values: Real, position: Index) -> Real:
    """Values (n,) less the mean of their position."""
    _, group = np.unique(position, return_inverse=True)
    return values - (np.bincount(group, values) / np.bincount(group))[group]


def write_certificate(unit: Certificate, folder: Path) -> dict[str, pd.DataFrame]:
    """Write the tables as CSV and Parquet, the compensation also as JSON, into ``folder``; their frames by name."""
    frames = write_tables({METRICS_TABLE: unit.metrics, COMPENSATION: unit.compensation}, folder, as_csv=True)
    bounds = pd.DataFrame([vars(bound) for bound in unit.bounds], columns=["metric", "crank_deg", "quantity", "value"])
    write_csv(bounds, folder / "bounds.csv")
    median = np.median(unit.loops.angle, axis=0)
    write_json(
        folder / "compensation.json",
        {
            "unit": unit.label,
            "crank_deg": unit.loops.crank_deg.tolist(),
            "torque_Nm": unit.loops.torque.tolist(),
            "error_arcmin": {"rising": median[:, 0].tolist(), "falling": median[:, 1].tolist()}
            if unit.is_predicted
            else None,
        },
    )
    return {**frames, "bounds": bounds}


def limit_sentence(unit: Certificate) -> str:
    """Whether the unit meets its limits, at which angles, and what of the gauge is in it."""
    names: Sequence[str] = unit.measured_dimensions
    dimension_count = f"{len(names)} measured dimensions" if len(names) != 1 else "1 measured dimension"
    if unit.meets_all is None:
        return f"{unit.label}: {dimension_count}; the study {unit.study.name} sets no limits."
    angles = (
        f"at the {len(unit.loops.crank_deg)} crank angles that were solved, its clearance backlash also at "
        f"{unit.study.cycle.rigid_angles} over the turn"
    )
    share, level = unit.meets_all, 100 * unit.study.metrics.confidence
    gauge = (
        f"The uncertainty of the gauge, {unit.measured_to_um:g} um, is in it."
        if unit.measured_to_um
        else "The uncertainty of the gauge is not in it: state it as measured_to_um with the dimensions."
    )
    if unit.is_determined:
        meets = "meets" if share.value else "does not meet"
        return (
            f"{unit.label}: with {dimension_count} nothing that varies is left to draw. The unit {meets} every limit "
            f"{angles}: {_margins_text(unit)}. At all angles of the turn it may be worse. {gauge}"
        )
    drawn = "draws of the other dimensions" + (" and of the error of the gauge" if unit.measured_to_um else "")
    return (
        f"{unit.label}: with {dimension_count} the unit meets every limit with a probability of "
        f"{100 * share.value:.3g} % ({level:g} % CI {100 * share.ci_low:.3g} to {100 * share.ci_high:.3g}, {share.n} "
        f"{drawn}), {angles}; at all angles of the turn it may be lower. {gauge}"
    )


def _margins_text(unit: Certificate) -> str:
    """Limit by limit the value of a determined unit, and by how much it meets or misses the limit."""
    values, metrics = unit.metrics.set_index("metric")["median"], {**library(), **turn_library()}
    texts = []
    for name, limit in unit.study.limits.of_metrics.items():
        metric, value = metrics[name], float(values.get(name, np.nan))
        number = f" {value:.4g} {metric.unit}" if np.isfinite(value) else ""
        texts.append(f"{metric.inline}{number} ({margin_text(metric, value, limit)})")
    return "; ".join(texts)


def margin_text(metric: Limited, value: float, limit: float) -> str:
    """Whether a value meets a limit, and by how much."""
    if not np.isfinite(value):
        return f"limit {limit:g}, no value"
    is_met = bool(metric.keeps(np.array(value), limit))
    return f"limit {limit:g}, {'met' if is_met else 'missed'} by {abs(value - limit):.2g}"
