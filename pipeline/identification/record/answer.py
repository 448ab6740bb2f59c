"""What a record says of a drive: verdict, lost motion and rigidity from both senses, and the orders of its error."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.arrays import Real, Truth, Whole
from pipeline.identification.identify import one_thread
from pipeline.identification.measurement.turning.motion import LEVEL_SHARE
from pipeline.identification.record.error_orders import WIDTH, OrderRow, error_orders
from pipeline.identification.record.evidence import Points, RecordEvidence, points_of
from pipeline.identification.record.judging import Judgement, RecordJudge, Trial, parts_of
from pipeline.identification.record.terms import TOLERATED_SHARE, Term, base_terms, effects
from pipeline.identification.record.turn_record import DEGREES_A_SECOND, TurnRecord
from pipeline.identification.selection.statements.verdict import ADEQUATE, UNEXPLAINED


@dataclass(frozen=True)
class Value:
    """A number of the drive with its 95 % interval."""

    name: str
    title: str
    unit: str
    value: float
    ci_low: float
    ci_high: float


@dataclass(frozen=True)
class LevelRow:
    """One held torque: mean of the senses about the middle of all, and forward less backward.

    Attributes
    ----------
    torque : [N m].
    mean, difference : [arcmin]; NaN where one sense is missing.
    mean_error, difference_error : standard errors [arcmin].
    """

    torque: float
    mean: float
    mean_error: float
    difference: float
    difference_error: float


@dataclass(frozen=True)
class ConditionRow:
    """What was measured at one temperature and speed.

    Attributes
    ----------
    temperature, speed : [deg C], [turns of the input a minute]; NaN where not measured.
    numbers : rigidities, and the difference of the senses at the largest torque.
    """

    temperature: float
    speed: float
    numbers: tuple[Value, ...]


@dataclass(frozen=True)
class HeldOut:
    """Prediction of one part from all others.

    Attributes
    ----------
    part : in words.
    rms, base_rms, repeat_rms : [arcmin] of the claimed model, of the base alone, and of the mean of the other passes.
    to_noise : of the claimed model, over noise and what its fit leaves open.
    """

    part: str
    rms: float
    base_rms: float
    repeat_rms: float
    to_noise: float


@dataclass(frozen=True)
class RecordAnswer:
    """All that is said of a record.

    Attributes
    ----------
    effects : those that were tested; ``why_not`` of the others.
    held_out_by : "torque", "temperature", "sense" or "".
    noise : of a point [arcmin].
    predicted_error : (n_points,) by the claimed model with the zeros of all places [arcmin].
    """

    record: TurnRecord
    points: Points
    evidence: RecordEvidence
    judgement: Judgement
    effects: tuple[Term, ...]
    why_not: dict[str, str]
    values: tuple[Value, ...]
    levels: tuple[LevelRow, ...]
    conditions: tuple[ConditionRow, ...]
    orders: tuple[OrderRow, ...]
    held_out_by: str
    held_out: tuple[HeldOut, ...]
    noise: float
    predicted_error: Real

    @property
    def titles(self) -> dict[str, str]:
        """Titles of the effects that were tested."""
        return {effect.name: effect.title for effect in self.effects}


@one_thread
def record_answer(record: TurnRecord) -> RecordAnswer:
    """The answer on a record without a fatal fault."""
    points = points_of(record)
    base, (tested_effects, why_not) = base_terms(record), effects(record)
    evidence = RecordEvidence(points, base, tested_effects)
    held_out_by, parts = parts_of(points, record.unit.settings.held_out.by)
    everything_turned = points_of(record, under_load=False)
    orders = error_orders(record, everything_turned)
    judgement = _with_orders(
        RecordJudge(evidence, tested_effects, parts, len(record.passes)).judgement(), orders, evidence.span
    )
    trial = judgement.answer
    model = evidence.predict_error(trial.effects, trial.posterior)
    everything = np.ones(len(points), bool)
    levels = _levels(record, everything_turned)
    return RecordAnswer(
        record=record,
        points=points,
        evidence=evidence,
        judgement=judgement,
        effects=tuple(tested_effects),
        why_not=why_not,
        values=tuple(_values(record, levels)),
        levels=tuple(levels),
        conditions=tuple(_conditions(record, everything_turned)),
        orders=tuple(orders),
        held_out_by=held_out_by,
        held_out=tuple(_held_out(record, evidence, held_out_by, parts, trial)),
        noise=evidence.unit,
        predicted_error=model + evidence.zeros(points.error - model, everything),
    )


def _with_orders(judgement: Judgement, orders: Sequence[OrderRow], span: float) -> Judgement:
    """The judgement; no record is adequate of which an order grows with the torque beyond what tolerances cause."""
    growing_rows = [row for row in orders if row.significant and row.per_torque > 60 * TOLERATED_SHARE * span]
    if judgement.verdict != ADEQUATE or not growing_rows:
        return judgement
    largest_row = max(growing_rows, key=lambda row: row.per_torque)
    finding = (
        f"order {largest_row.order:.3g}{f' ({largest_row.of})' if largest_row.of else ''} grows with the torque to "
        f"{largest_row.per_torque:.2g} arcsec, more than errors of parts within their tolerances cause"
    )
    return replace(judgement, verdict=UNEXPLAINED, finding=finding)


def effect_values(answer: RecordAnswer) -> list[Value]:
    """Sizes of the effects of the described model: amplitudes of waves, and sizes of the others."""
    trial, rows = answer.judgement.description, []
    for name in trial.effects:
        columns = answer.evidence.columns_of(trial.effects, name)
        mean, covariance = trial.posterior.mean[columns], trial.posterior.covariance[columns, columns]
        size = float(np.linalg.norm(mean))
        direction = mean / max(size, 1e-300)
        error = float(np.sqrt(direction @ covariance @ direction))
        value, least = (float(mean[0]), -np.inf) if len(mean) == 1 else (size, 0.0)
        low, high = max(value - WIDTH * error, least), value + WIDTH * error
        rows.append(Value(name, answer.titles[name], "arcmin", value, low, high))
    return rows


def _values(record: TurnRecord, levels: Sequence[LevelRow]) -> list[Value]:
    """Rigidity and lost motion with intervals, from mean and difference of the senses at the held torques."""
    values = [*_rigidities(record, levels)]
    least_row = min(levels, key=lambda row: abs(row.torque))
    if np.isfinite(least_row.difference):
        half = WIDTH * least_row.difference_error
        is_small = abs(least_row.torque) < LEVEL_SHARE * record.largest_torque
        title = f"difference of the senses at {abs(least_row.torque):.3g} N m"
        title = f"lost motion: {title}" if is_small else f"{title} (for the lost motion hold 3 % of the rated torque)"
        value = abs(least_row.difference)
        values.append(Value("lost_motion", title, "arcmin", value, max(value - half, 0.0), value + half))
    if max(levels, key=lambda row: abs(row.torque)) is not least_row:
        values += _lag_at_top(levels)
    return values


def _lag_at_top(levels: Sequence[LevelRow]) -> Iterator[Value]:
    """Difference of the senses at the largest torque; none of one sense."""
    row = max(levels, key=lambda row: abs(row.torque))
    if np.isfinite(row.difference):
        half, value = WIDTH * row.difference_error, abs(row.difference)
        title = f"difference of the senses at {row.torque:.3g} N m"
        yield Value("lag_at_top", title, "arcmin", value, max(value - half, 0.0), value + half)


def _rigidities(record: TurnRecord, levels: Sequence[LevelRow]) -> Iterator[Value]:
    """Rigidity of either sign of the torque between the largest one held and the next beyond half of it, or less."""
    for sign, name in ((1, "positive"), (-1, "negative")):
        loaded_rows = [row for row in levels if sign * row.torque >= LEVEL_SHARE * record.largest_torque]
        if len(loaded_rows) < 2:
            continue
        high, *other_rows = sorted(loaded_rows, key=lambda row: -abs(row.torque))
        low = min(other_rows, key=lambda row: abs(abs(row.torque) - 0.5 * abs(high.torque)))
        twist, torque = high.mean - low.mean, high.torque - low.torque
        half = WIDTH * float(np.hypot(high.mean_error, low.mean_error))
        if abs(twist) <= half:
            continue
        ends = sorted(abs(torque) / (abs(twist) + step) for step in (-half, half))
        has_both = np.isfinite(low.difference) and np.isfinite(high.difference)
        origin = "from the means of the senses" if has_both else "of one sense, the friction of the load included"
        title = f"torsional rigidity between {low.torque:.3g} and {high.torque:.3g} N m, {origin}"
        yield Value(f"rigidity_{name}", title, "N m/arcmin", abs(torque / twist), *ends)


def _conditions(record: TurnRecord, points: Points) -> Iterator[ConditionRow]:
    """Numbers at each temperature and speed, lowest first; none where all passes have one of both."""
    passes = record.passes
    conditions = np.column_stack([passes.temperature_group, passes.speed_group])
    of_kind = conditions[np.unique(passes.kind, return_index=True)[1]]
    for condition in np.unique(conditions, axis=0) if len(np.unique(conditions, axis=0)) > 1 else []:
        of_pass = np.all(conditions == condition, axis=1)
        rows = _levels(record, points, np.all(of_kind[points.kind] == condition, axis=1))
        speed = float(np.mean(passes.speed[of_pass])) * record.orders.ratio / DEGREES_A_SECOND
        numbers = [*_rigidities(record, rows), *_lag_at_top(rows)]
        yield ConditionRow(float(np.mean(passes.temperature[of_pass])), speed, tuple(numbers))


def _levels(record: TurnRecord, points: Points, counted_points: Truth | bool = True) -> list[LevelRow]:
    """Mean of the senses at each held torque, over all intervals, and their difference over those that both have."""
    rows, middle = [], float(np.mean([points.error[points.kind == kind].mean() for kind in np.unique(points.kind)]))
    for level, torque in enumerate(record.levels):
        of_sense = []
        for sense in (1, -1):
            in_level = (points.level == level) & (points.sense == sense) & counted_points
            count = np.bincount(points.interval[in_level], minlength=record.n_intervals)
            with np.errstate(invalid="ignore"):
                of_sense.append(
                    np.bincount(points.interval[in_level], points.error[in_level], record.n_intervals) / count
                )
        forward, backward = of_sense
        mean = np.nanmean(np.stack(of_sense)) - middle if np.any(np.isfinite(np.stack(of_sense))) else np.nan
        difference = forward - backward
        known_differences = difference[np.isfinite(difference)]
        noise = float(np.median(points.noise))
        size = len(known_differences)
        rows.append(
            LevelRow(
                float(torque),
                float(mean),
                noise / np.sqrt(max(2 * size, 1)),
                float(known_differences.mean()) if size else float("nan"),
                float(np.sqrt(2) * noise / np.sqrt(size)) if size else float("nan"),
            )
        )
    return rows


def _held_out(
    record: TurnRecord, evidence: RecordEvidence, held_out_by: str, parts: Whole, trial: Trial
) -> list[HeldOut]:
    """Each part predicted from the others; nothing where none can be held out."""
    if not held_out_by:
        return []
    points, rows = evidence.points, []
    for number in np.unique(parts):
        is_held_out = parts == number
        errors = {}
        for name, names, structure in (("claimed", trial.effects, trial.structure), ("base", (), None)):
            posterior = evidence.posterior(names, structure or evidence.most_likely(()), int(number), parts)
            model = evidence.predict_error(names, posterior)
            errors[name] = evidence.unused_misfit(points.error - model, is_held_out, trial.effects)
        repeat_error = evidence.unused_misfit(points.error, is_held_out, trial.effects)
        claimed_error, base, repeat = (
            float(np.sqrt(np.nanmean(values**2))) for values in (errors["claimed"], errors["base"], repeat_error)
        )
        to_noise = float(np.sqrt(np.nanmean((errors["claimed"] / points.noise[is_held_out]) ** 2)))
        rows.append(HeldOut(_part_text(record, held_out_by, int(number)), claimed_error, base, repeat, to_noise))
    return rows


def _part_text(record: TurnRecord, held_out_by: str, number: int) -> str:
    if held_out_by == "torque":
        return f"{record.levels[number]:.3g} N m"
    if held_out_by == "sense":
        return "backward" if number else "forward"
    passes = record.passes
    return f"{passes.temperature[passes.temperature_group == number].mean():.3g} °C"
