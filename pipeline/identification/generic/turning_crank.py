"""A drive of play, spring and friction whose crank turns within the loop that is measured.

With the output locked, the motor turns the crank through i times the twist: all that depends on the crank angle then
varies within one loop. The crank angle is phi = phi_0 - i a of the measured angle a, i being the turns of the crank
per turn of the output: -Z with the housing held, N with the flange held. Below i' = -i.

Virtual work. With the strain s = a - te(phi) of the drive and its energy V, the torque at the motor, times the
ratio, is dV/da. Written with the complementary energy W(T, phi), the integral of s + te over the output's torque T,

    torque at the motor = T - i' dW/dphi at constant T + friction,

so that an angle error makes the factor 1 - i' te', and a compliance or a play that varies acts through its own W.
An error of the encoder is read and does no work. Where the torque is measured at the output, there is no such term.

Friction is a play operator of half-width Tc + mu |T| (Visintin, Differential Models of Hysteresis (1994)). In a soft
material it lets go in stages: ``STAGES`` such operators in series with spread thresholds (Masing, 1926; Iwan, J. Appl.
Mech. 33 (1966) 893), and each side's first loading softens it (Mullins, Rubber Chem. Technol. 42 (1969) 339).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.generic.drive_terms import CRANK_EFFECTS
from pipeline.identification.generic.play_and_friction import carried_torque
from pipeline.model.compiled import entry

Real = NDArray[np.float64]
Whole = NDArray[np.int64]
Truth = NDArray[np.bool_]

STAGES = 5
"""Friction elements in series where their thresholds are spread."""
ROUNDS, CLOSE = 40, 1e-6
"""Most times that twist and crank angle are found from each other, and change of the angle [arcmin] that ends it: each
time changes it by a tenth of the time before."""
STEPS = 3
"""Times that the torque at the output is found from the energy of play and compliance that vary."""


@dataclass(frozen=True)
class CrankLoops:
    """Loops of one state of a drive, cells in time order.

    Attributes
    ----------
    position : (n_cells,) from 0; each position has a zero of its own, unless ``common_zero``.
    torque : (n_cells, n_parts) that each cell went through [N m].
    angle : (n_cells,) [arcmin].
    weight : (n_cells,) of the squared errors.
    crank : (n_cells,) angle of the crank [rad] at the position's first row, over a turn of the output; or, with
        ``crank_per_output`` = 0, at each cell.
    start : (n_cells,) reading of the angle at the position's first row [arcmin].
    crank_per_output : change of the crank angle with the reading [rad/arcmin]; 0 where the crank is fixed, or given by
        a column.
    at_input : whether the torque was measured at the input, so that virtual work counts.
    ratio : i, turns of the crank per turn of the output, with its sign.
    behind_disk : share of the twist that lies between the disk and the output: the disk turns by that share of phi/i.
    common_zero : whether all positions share one zero.
    """

    position: Whole
    torque: Real
    angle: Real
    weight: Real
    crank: Real
    start: Real
    crank_per_output: float = 0.0
    at_input: bool = True
    ratio: float = np.inf
    behind_disk: float = 1.0
    common_zero: bool = False

    @cached_property
    def top(self) -> float:
        """Largest torque [N m]."""
        return float(np.max(np.abs(self.torque)))

    @cached_property
    def span(self) -> float:
        """Largest range of the angle at a position [arcmin]."""
        return max(float(np.ptp(self.angle[self.position == p])) for p in np.unique(self.position))

    @cached_property
    def group(self) -> Whole:
        """Cells (n_cells,) that share a zero."""
        return np.zeros_like(self.position) if self.common_zero else self.position

    @cached_property
    def runs(self) -> Whole:
        """Position of each part of a cell (n_cells n_parts,), in time order."""
        return np.repeat(self.position, self.torque.shape[1])

    def some(self, cells: Truth) -> CrankLoops:
        """The loops with no weight but that of some cells (n_cells,), if their group has any; histories stay whole."""
        return replace(self, weight=np.where(cells, self.weight, 0.0))

    def zeros(self, residual: Real) -> Real:
        """Mean residual of each cell's group (n_cells,), weighed; of cells without weight where a group has none."""
        count = int(self.group.max()) + 1
        total = np.bincount(self.group, self.weight, count)
        weight = np.where(total[self.group] > 0, self.weight, 1.0)
        means = np.bincount(self.group, weight * residual, count) / np.bincount(self.group, weight, count)
        return means[self.group]


@dataclass(frozen=True)
class CrankAngle:
    """Angle of the crank [rad] (n,) against the ``housing`` and against the ``disk``, and d disk / d housing."""

    housing: Real
    disk: Real
    disk_rate: float

    @classmethod
    def from_readings(cls, loops: CrankLoops, from_start: Real) -> CrankAngle:
        """At readings less that of the position's first row (n_cells n_parts,) [arcmin]."""
        start, turn = np.repeat(loops.crank, loops.torque.shape[1]), loops.crank_per_output * from_start
        rate = 1 - loops.behind_disk / loops.ratio
        return cls(start + turn, start * (1 - 1 / loops.ratio) + rate * turn, rate)


class LoopModel:
    """Predictions of one state's loops; keeps what friction leaves of the torque, which other numbers do not change."""

    def __init__(self, loops: CrankLoops):
        self.loops = loops
        self._last_torque: tuple[tuple[float, ...], Real] = (), np.empty((0, 0))
        self._zeros = loops.zeros(loops.angle)

    def predict_angle(self, values: Mapping[str, float]) -> Real:
        """Angle (n_cells,) [arcmin], each group with the zero that fits its cells best.

        Parameters
        ----------
        values : of the numbers of ``drive_terms``; those that are not given are none.
        """
        loops = self.loops
        net_torque = self._net_torque(values)
        softening = np.array([self._softening(torque, values) for torque in net_torque])
        parts = loops.torque.shape[1]
        spring_angle, cells = np.zeros(loops.torque.size), self._zeros
        error_at_start = _wave("reading", CrankAngle.from_readings(loops, spring_angle), values)[0][::parts]
        from_start = np.repeat(self._zeros - loops.start + error_at_start, parts)
        for _ in range(ROUNDS):
            angle_before = cells
            crank = CrankAngle.from_readings(loops, from_start + spring_angle)
            spring_angle = _twist(net_torque, softening, crank, values, loops)
            twist = (spring_angle + _wave("reading", crank, values)[0]).reshape(-1, parts).mean(axis=1)
            self._zeros = loops.zeros(loops.angle - twist)
            cells = twist + self._zeros
            from_start = np.repeat(self._zeros - loops.start + error_at_start, parts)
            if np.max(np.abs(cells - angle_before)) < CLOSE or not _goes_with_the_crank(values):
                break
        return cells

    def _net_torque(self, values: Mapping[str, float]) -> Real:
        """Torque (n_stages, n_cells n_parts) [N m] behind the friction of each stage, as it is measured."""
        spread = values.get("friction_spread", 0.0)
        numbers = values["friction_Nm"], values["load_friction"], spread
        if self._last_torque[0] != numbers:
            stages = 1 + spread * np.linspace(-1, 1, STAGES) if spread else np.ones(1)
            torque = self.loops.torque.ravel()
            net = [
                carried_torque(torque, self.loops.runs, *(max(s, 0.0) * np.array(numbers[:2])).tolist()) for s in stages
            ]
            self._last_torque = numbers, np.array(net)
        return self._last_torque[1]

    def _softening(self, torque: Real, values: Mapping[str, float]) -> Real:
        """Factor of the twist (n,) of a stage, by its sense and the largest torque so far on its side."""
        factor: Real = 1 + values.get("asymmetry", 0.0) * np.sign(torque)
        growth = values.get("first_loading", 0.0) / self.loops.top
        return factor * (1 + growth * largest_on_its_side(torque, self.loops.runs)) if growth else factor


def _twist(
    net_torque: Real, softening: Real, crank: CrankAngle, values: Mapping[str, float], loops: CrankLoops
) -> Real:
    """Twist and angle error (n,) [arcmin] at crank angles (n,) [rad] under torques (n_stages, n) of each stage."""
    error, slope = _wave("angle", crank, values)
    factors = [wave for part in ("play", "compliance") for wave in _wave(part, crank, values)]
    spring = values["play_arcmin"], values["knee_Nm"], values["compliance_arcmin_per_Nm"]
    return error + spring_twist(
        net_torque, softening, slope, *factors, loops.crank_per_output if loops.at_input else 0.0, *spring
    )


def _wave(acts_on: str, crank: CrankAngle, values: Mapping[str, float]) -> tuple[Real, Real]:
    """Sum of the effects that act on something, and its derivative by the crank angle, each (n,)."""
    wave, slope = np.zeros_like(crank.housing), np.zeros_like(crank.housing)
    for name, effect in CRANK_EFFECTS.items():
        if effect.acts_on != acts_on:
            continue
        cosine, sine = (values.get(number, 0.0) for number in effect.numbers(name))
        if cosine or sine:
            angle, rate = (crank.disk, crank.disk_rate) if effect.per_disk else (crank.housing, 1.0)
            c, s = np.cos(effect.order * angle), np.sin(effect.order * angle)
            wave, slope = wave + cosine * c + sine * s, slope + effect.order * rate * (sine * c - cosine * s)
    return wave, slope


def _goes_with_the_crank(values: Mapping[str, float]) -> bool:
    """Whether any effect of the crank angle has a size."""
    return any(values.get(number) for name, effect in CRANK_EFFECTS.items() for number in effect.numbers(name))


@entry
def spring_twist(
    net_torque: Real,
    softening: Real,
    slope: Real,
    play_wave: Real,
    play_slope: Real,
    compliance_wave: Real,
    compliance_slope: Real,
    crank_per_output: float,
    play: float,
    knee: float,
    compliance: float,
) -> Real:
    """Mean twist (n,) [arcmin] of springs in series under torques (n_stages, n), as measured at the motor.

    ``slope`` (n,) of the angle error and the slopes of play and compliance over the crank angle act on the torque at
    the output, by virtual work.
    """
    n_stages, n = net_torque.shape
    total = np.zeros(n)
    varies = crank_per_output != 0.0 and (np.any(play_slope != 0.0) or np.any(compliance_slope != 0.0))
    for k in range(n_stages):
        for i in range(n):
            factor, size = 1 - crank_per_output * slope[i], abs(net_torque[k, i])
            sense = 1.0 if net_torque[k, i] > 0.0 else -1.0
            load = size / factor
            for _ in range(STEPS if varies else 0):
                energy = play_slope[i] * 0.5 * play * (load - knee * (1 - np.exp(-load / knee)))
                energy += compliance_slope[i] * 0.5 * compliance * load * load
                load = max((size + sense * crank_per_output * energy * softening[k, i]) / factor, 0.0)
            gap = 0.5 * play * (1 - np.exp(-load / knee)) * (1 + play_wave[i])
            total[i] += sense * (gap + compliance * load * (1 + compliance_wave[i])) * softening[k, i] / n_stages
    return total


@entry
def largest_on_its_side(torque: Real, runs: Whole) -> Real:
    """Largest size (n,) that torques (n,) of the same sense had so far, from each run's start."""
    largest_torque = np.empty(len(torque))
    rising, falling = 0.0, 0.0
    for k in range(len(torque)):
        if k == 0 or runs[k] != runs[k - 1]:
            rising, falling = 0.0, 0.0
        rising, falling = max(rising, torque[k]), max(falling, -torque[k])
        largest_torque[k] = rising if torque[k] > 0.0 else falling
    return largest_torque
