"""What a bench does to a unit: turning torques, rows in time, temperature, noise and quantisation."""

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Real, Whole
from pipeline.identification.measurement.cells import CELLS_PER_SENSE
from pipeline.model.effects import Conditions

ROWS = 2000
"""Rows of one position."""
TEMPERATURE_C = 20.0
"""At which the dimensions hold."""


PIECES = 24
"""Parts of a cycle in which wear stands still."""


@dataclass(frozen=True)
class Ramp:
    """What one position is put through.

    Attributes
    ----------
    turns : (n_turns,) [N m] torque as read at the start, at each turn and at the end.
    leg_cycle : (n_turns - 1,) cycle of each leg.
    torque, time : (n_rows,) [N m] as read without noise, [s] from the start of the position.
    leg : (n_rows,)
    begin : [s] of the position within the measurement.
    temperature : (n_cycles,) [deg C]
    """

    turns: Real
    leg_cycle: Whole
    torque: Real
    time: Real
    leg: Whole
    begin: float
    temperature: Real

    @property
    def cycle(self) -> Whole:
        """Cycle of every row (n_rows,)."""
        return self.leg_cycle[self.leg]

    @property
    def n_cycles(self) -> int:
        return int(self.leg_cycle[-1]) + 1

    @property
    def sense(self) -> Real:
        """+1 where the torque of the row rises, -1 where it falls (n_rows,)."""
        return np.sign(np.diff(self.turns))[self.leg]

    @property
    def rate(self) -> Real:
        """Speed of the torque at every row (n_rows,) [N m/s]."""
        return np.gradient(self.torque, self.time)

    @property
    def travelled(self) -> Real:
        """Way of the torque to every row (n_rows,), over the usual one of a cycle."""
        travel = np.append(0.0, np.cumsum(np.abs(np.diff(self.turns))))
        here = travel[self.leg] + np.abs(self.torque - self.turns[self.leg])
        return np.asarray(here * self.n_cycles / travel[-1])

    def states(self, wears: bool) -> tuple[Whole, Conditions]:
        """State of every row (n_rows,) and its conditions: of each cycle, or of a part of one where the drive wears."""
        part = np.floor(PIECES * self.travelled).astype(int) if wears else 0
        number = np.unique(self.cycle * PIECES * (self.n_cycles + 1) + part, return_inverse=True)[1].ravel()
        first_rows = np.unique(number, return_index=True)[1]
        travelled = np.bincount(number, self.travelled) / np.bincount(number)
        return number, Conditions(travelled, self.temperature[self.cycle[first_rows]] - TEMPERATURE_C)


@dataclass(frozen=True)
class Bench:
    """A measurement of some positions.

    Attributes
    ----------
    cranks : (n_positions,) [deg] ascending.
    ramps : one per position.
    locked : "input" or "output".
    offset : (n_positions,) [arcmin], equal where all positions share one zero.
    common : whether they do.
    timed, warmed : whether the time and the temperature are in the file.
    floor_share : noise floor of a cell as a share of the angle's range.
    angle_steps : resolution of the angle in its noise.
    torque_noise, torque_step : [N m]
    """

    cranks: tuple[float, ...]
    ramps: tuple[Ramp, ...]
    locked: str
    offset: Real
    common: bool
    timed: bool
    warmed: bool
    floor_share: float
    angle_steps: float
    torque_noise: float
    torque_step: float


def draw_bench(rng: np.random.Generator, cranks: tuple[float, ...], rated_torque: float) -> Bench:
    """A bench for a reducer of the rated torque [N m] with some of the crank angles [deg] at hand."""
    n = int(rng.choice([3, 4, 6], p=[0.75, 0.17, 0.08]))
    chosen = tuple(sorted(rng.choice(cranks, size=n, replace=False).tolist()))
    top = rated_torque * float(rng.uniform(0.7, 1.0))
    plan = _plan(rng)
    warmed = bool(rng.random() < 0.35)
    speeds = rng.uniform(0.4, 2.5, size=max(cycle for _, cycle in plan) + 1) if rng.random() < 0.5 else None
    duration = float(rng.uniform(30, 150))
    begin, ramps = 0.0, []
    for _ in chosen:
        ramp = _ramp(rng, plan, top, begin, duration, speeds, warmed)
        begin += float(ramp.time[-1] + rng.uniform(60, 600))
        ramps.append(ramp)
    common = bool(rng.random() < 0.5)
    offset = np.full(n, rng.normal(0, 5)) if common else rng.normal(0, 5, size=n)
    noise = top * float(10 ** rng.uniform(-3.3, -2.5))
    return Bench(
        cranks=chosen,
        ramps=tuple(ramps),
        locked=str(rng.choice(["input", "output"])),
        offset=offset,
        common=common,
        timed=bool(warmed or rng.random() < 0.85),
        warmed=warmed,
        floor_share=float(10 ** rng.uniform(np.log10(0.003), np.log10(0.02))),
        angle_steps=float(rng.uniform(0.2, 1.0)),
        torque_noise=noise,
        torque_step=noise * float(rng.uniform(0.2, 1.0)),
    )


def _plan(rng: np.random.Generator) -> list[tuple[float, int]]:
    """Turns as shares of the largest torque, each with the cycle of its leg; the first is the start."""
    first_sense = float(rng.choice([1.0, -1.0]))
    start = 0.0 if rng.random() < 0.7 else float(rng.uniform(-0.5, 0.5))
    inner = float(rng.uniform(-0.3, 0.5)) if rng.random() < 0.35 else None
    plan = [(start, 0)]
    for cycle in range(int(rng.integers(2, 5))):
        plan.append((first_sense, cycle))
        if inner is not None:
            plan += [(first_sense * inner, cycle), (first_sense, cycle)]
        plan.append((-first_sense, cycle))
    return plan


def _ramp(
    rng: np.random.Generator,
    plan: list[tuple[float, int]],
    top: float,
    begin: float,
    duration: float,
    speeds: Real | None,
    warmed: bool,
) -> Ramp:
    shares = np.array([share for share, _ in plan])
    turns = top * (shares + np.where(np.abs(shares) == 1, rng.normal(0, 0.002, size=len(shares)), 0.0))
    cycle = np.array([number for _, number in plan[1:]])
    n_cycles = int(cycle[-1]) + 1
    travel = np.abs(np.diff(turns))
    rows = np.maximum(np.round(ROWS * travel / travel.sum()).astype(int), 6)
    fast = np.ones(n_cycles) if speeds is None else speeds
    period = duration * travel / (4 * top) / fast[cycle]
    torque, time, elapsed = [], [], 0.0
    for leg, count in enumerate(rows):
        share = (np.arange(count) + 0.5) / count
        torque.append(turns[leg] + share * (turns[leg + 1] - turns[leg]))
        time.append(elapsed + share * period[leg])
        elapsed += period[leg]
    warm = TEMPERATURE_C + rng.uniform(-8, 25, size=n_cycles) if warmed else np.full(n_cycles, TEMPERATURE_C)
    return Ramp(
        turns=turns,
        leg_cycle=cycle,
        torque=np.concatenate(torque),
        time=np.concatenate(time),
        leg=np.repeat(np.arange(len(rows)), rows),
        begin=begin,
        temperature=warm,
    )


def rows_a_cell(bench: Bench) -> float:
    """Rows that a cell averages, as far as the design of cells goes."""
    ramp = bench.ramps[0]
    levels = CELLS_PER_SENSE * np.sum(np.abs(np.diff(ramp.turns))) / np.max(np.abs(ramp.turns))
    return max(ROWS / float(levels), 3.0)


def quantised(values: Real, step: float) -> Real:
    """Values at whole multiples of the step."""
    return step * np.round(values / step) if step > 0 else values
