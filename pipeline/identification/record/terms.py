"""What the error of a turning drive may depend on beside the place: the terms of every record, and the effects.

Every interval of the output angle has a zero of its own under torques of either sign: the error that the size of the
torque, sense and temperature do not change is the unit's, and is described by its orders. A term or effect is one or
two columns over the cells; each column is scaled so that its size is an angle [arcmin] at the largest torque, in either
sense or at either end of the temperatures.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Real
from pipeline.identification.measurement.enough import FEWEST_OF_A_WAVE
from pipeline.identification.measurement.turning.motion import LEVEL_SHARE
from pipeline.identification.record.passes import SAME_SPEED, SAME_TEMPERATURE_K
from pipeline.identification.record.turn_record import TurnRecord

MOST_STRAIGHT = 2
"""Sizes of torque that tell no softening from the zeros."""
LEAST_WAVES = 1.0
"""Waves over the angle that was turned from which one can be tested, and beats from which two are told apart."""
BASE_SHARE = 10.0
"""Prior standard deviation of a term that every record has, in the range of the mean errors: equal in all models."""
EFFECT_SHARE = 0.1
"""The same of an effect."""
TOLERATED_SHARE = 0.0025
"""Amplitude of a compliance that varies with a shaft, over the range of the mean errors, that errors of parts within
their tolerances cause. Calibrated: generated reducers without an effect have at most 0.15 %. Also the prior standard
deviation of a compliance that differs between torques of either sign, which they cause as well."""


@dataclass(frozen=True)
class Term:
    """Columns over the cells that belong together.

    Attributes
    ----------
    name, title : of the term.
    physics : what it is; empty of the terms that every record has.
    columns : (n_cells, 1 or 2), each with an angle [arcmin] for its size.
    prior_share : standard deviation of each size before the data, in the range of the mean errors.
    waves : over the angle that was turned; 0 of a term that is no wave.
    """

    name: str
    title: str
    physics: str
    columns: Real
    prior_share: float = EFFECT_SHARE
    waves: float = 0.0


@dataclass(frozen=True)
class Covariates:
    """What the cells differ in, scaled.

    Attributes
    ----------
    torque : (n_cells,) over the largest torque that is held.
    sense : (n_cells,) 1 forward, -1 backward.
    lag : (n_cells,) difference of the senses at each held torque over the largest one.
    warm, fast : (n_cells,) temperature and speed about their means, -1 to 1 at most; zeros where they do not vary.
    """

    torque: Real
    sense: Real
    lag: Real
    warm: Real
    fast: Real

    @classmethod
    def from_record(cls, record: TurnRecord) -> "Covariates":
        """Those of a record."""
        cells, passes = record.cells, record.passes
        torque = cells.torque / max(float(np.abs(record.levels).max()), 1e-12)  # that held, not what a meter peaks at
        sense = passes.sense[cells.owner].astype(float)
        temperature = passes.temperature - _middle(passes.temperature)
        reach = float(np.nanmax(np.abs(temperature))) if np.any(np.isfinite(temperature)) else 0.0
        warm = np.nan_to_num(temperature)[cells.owner] / reach if 2 * reach > SAME_TEMPERATURE_K else 0 * torque
        speed = passes.speed - _middle(passes.speed)
        varies = np.all(np.isfinite(speed)) and passes.speed.max() > SAME_SPEED * passes.speed.min()
        fast = speed[cells.owner] / np.max(np.abs(speed)) if varies else 0 * torque
        return cls(torque, sense, _lags(record), warm, fast)


def _lags(record: TurnRecord) -> Real:
    """Difference of the senses at each cell's held torque over the largest one (n_cells,); ones without both senses."""
    level, sense = (values[record.cells.owner] for values in (record.passes.level, record.passes.sense))
    lags = np.ones(len(record.levels))
    for number in range(len(lags)):
        senses = [record.cells.error[(level == number) & (sense == sign)] for sign in (1, -1)]
        lags[number] = abs(senses[0].mean() - senses[1].mean()) if all(map(len, senses)) else np.nan
    if not np.all(np.isfinite(lags)) or not lags.max() > 0:
        return np.ones(len(level))
    is_loaded = np.abs(record.levels) >= LEVEL_SHARE * record.largest_torque
    relative_lags: Real = (lags / lags[is_loaded].max() if is_loaded.any() else lags / lags.max())[level]
    return relative_lags


def _middle(values: Real) -> float:
    """Middle of the range of values; NaN of none."""
    finite = values[np.isfinite(values)]
    return 0.5 * float(finite.min() + finite.max()) if finite.size else float("nan")


def base_terms(record: TurnRecord) -> list[Term]:
    """The terms that every drive has under torque, as far as the record can tell them apart."""
    values = Covariates.from_record(record)
    sizes, has_both_senses = loaded_sizes(record), loaded_both_ways(record)
    torque, sense = values.torque, values.sense
    candidates = {
        "compliance": ("compliance", torque, sizes > 1),
        "softening": ("growth of the twist with the torque squared", torque * np.abs(torque), sizes > MOST_STRAIGHT),
        "asymmetry": (
            "compliance that differs between torques of either sign: other flanks carry, with errors of their own",
            np.abs(torque),
            min(loaded_sizes(record, sign) for sign in (1, -1)) > 1,
        ),
        "friction": ("half of the lag between the senses, alike at all torques", sense, has_both_senses),
        "load_friction": (
            "half of the lag in proportion to the torque",
            sense * np.abs(torque),
            has_both_senses and sizes > 1,
        ),
    }
    return [
        Term(name, title, "", column[:, None], TOLERATED_SHARE if name == "asymmetry" else BASE_SHARE)
        for name, (title, column, is_usable) in candidates.items()
        if is_usable
    ]


def loaded_sizes(record: TurnRecord, sign: int = 0) -> int:
    """How many sizes of torque beside zero were held, of one ``sign`` or of both."""
    sizes = (record.levels * sign if sign else np.abs(record.levels)) / max(record.largest_torque, 1e-12)
    return len(np.unique(np.round(sizes[sizes >= LEVEL_SHARE] / LEVEL_SHARE)))


def loaded_both_ways(record: TurnRecord) -> bool:
    """Whether a torque other than zero was held in both senses; a brake that opposes the motion holds none so."""
    passes = record.passes
    is_loaded = np.abs(record.levels) >= LEVEL_SHARE * record.largest_torque
    return any(len(np.unique(passes.sense[passes.level == level])) > 1 for level in np.flatnonzero(is_loaded))


def effects(record: TurnRecord) -> tuple[list[Term], dict[str, str]]:
    """The effects that a record can test, and why not of the others, by name."""
    values, tested_terms, reasons = Covariates.from_record(record), [], {}
    one_sense = "" if loaded_both_ways(record) else ONE_SENSE
    for term, reason in (*_thermal_and_speed_terms(record, values, one_sense), *_waves(record, values, one_sense)):
        if reason:
            reasons[term.name] = reason
        else:
            tested_terms.append(term)
    return tested_terms, reasons


COMPLIANCE = (
    "bearings, teeth or supports of unlike stiffness follow each other: the error grows in proportion to the torque, "
    "alike in both senses"
)
FRICTION = "the torque that friction takes varies over the turn: the senses lag unlike, at all torques"
ONE_LEVEL = "fewer than two sizes of torque beside zero are held"
ONE_SENSE = "no torque beside zero is held in both senses"


def _order_refusal(record: TurnRecord, order: float) -> str:
    """Why waves of an order cannot be tested, or ""."""
    waves = order * record.span_deg / 360.0
    if waves < LEAST_WAVES:
        return f"the record covers {waves:.2g} of a wave"
    if record.n_intervals < FEWEST_OF_A_WAVE * waves:
        return f"{record.n_intervals} intervals hold {waves:.0f} waves; a wave takes {FEWEST_OF_A_WAVE} intervals"
    return ""


def _thermal_and_speed_terms(record: TurnRecord, values: Covariates, one_sense: str) -> Iterator[tuple[Term, str]]:
    """Effects of temperature and speed, and the reason against each."""
    steady_temperature = "" if np.any(values.warm) else "no temperature that varies"
    steady_speed = "" if np.any(values.fast) else "no speed that varies"
    one_level = "" if loaded_sizes(record) > 1 else ONE_LEVEL
    title = "zero of the error that moves with the temperature"
    physics = "parts of unlike expansion, or the holder of an encoder, move as the drive warms"
    yield Term("zero_over_temperature", title, physics, values.warm[:, None]), steady_temperature
    title = "compliance that changes with the temperature"
    physics = "clearances and moduli change: the spring of a warm drive differs"
    column = values.warm * values.torque
    yield Term("compliance_over_temperature", title, physics, column[:, None]), steady_temperature or one_level
    title, physics = "friction that changes with the temperature", "the lubricant gets thinner"
    column = values.warm * values.sense * values.lag
    yield Term("friction_over_temperature", title, physics, column[:, None]), steady_temperature or one_sense
    title = "friction that changes with the speed"
    physics = "viscous or mixed friction of the lubricant (Stribeck)"
    column = values.fast * values.sense * values.lag
    yield Term("friction_over_speed", title, physics, column[:, None]), steady_speed or one_sense


def _waves(record: TurnRecord, values: Covariates, one_sense: str) -> Iterator[tuple[Term, str]]:
    """Effects that vary with the turn of a shaft, and the reason against each."""
    one_level = "" if len(record.levels) > 1 else ONE_LEVEL
    for wave, (title, order) in record.orders.waves.items():
        columns, waves = np.column_stack(record.wave(order)), order * record.span_deg / 360
        missing = _order_refusal(record, order)
        for name, physics, factor, reason in (
            ("compliance", COMPLIANCE, values.torque, one_level),
            ("friction", FRICTION, values.sense, one_sense),
        ):
            of_wave = f"{name} that varies {title}"
            yield Term(f"{name}_{wave}", of_wave, physics, factor[:, None] * columns, waves=waves), missing or reason
