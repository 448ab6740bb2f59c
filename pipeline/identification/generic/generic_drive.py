"""A drive without a design: elements in series behind friction, whose crank may turn within the loop that is measured.

The elements are those of ``pipeline.model.elements``: a play and a spring, a delayed one, friction that is rigid until
it slides, and the memory of the first loading.

With the output locked, the motor turns the crank through i times the twist: all that depends on the crank angle then
varies within one loop. The crank angle is phi = phi_0 - i a of the measured angle a, i being the turns of the crank
per turn of the output: -Z with the housing held, N with the flange held. Below i' = -i.

Virtual work. With the strain s = a - te(phi) of the drive and its energy V, the torque at the motor, times the
ratio, is dV/da. Written with the complementary energy W(T, phi), the integral of s + te over the output's torque T,

    torque at the motor = T - i' dW/dphi at constant T + friction,

so that an angle error makes the factor 1 - i' te', and a compliance or a play that varies acts through its own W.
An error of the encoder is read and does no work. Where the torque is measured at the output, there is no such term.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.arrays import Index, Real
from pipeline.constant_kinds import Fineness, Rounding
from pipeline.identification.generic.crank_loops import CrankAngle, CrankLoops
from pipeline.identification.generic.drive_terms import CRANK_EFFECTS, TERMS, CrankEffect
from pipeline.model.effects.compliance import LinearSpring
from pipeline.model.effects.creep import KelvinVoigt
from pipeline.model.elements import FirstLoading, Path, RoundedPlay, SlidingFriction, Spring

ROUNDS: Fineness = 40
"""Most times that twist and crank angle are found from each other: each changes it by a tenth of the time before."""
CLOSE: Rounding = 1e-6
"""Change of the angle [arcmin] that ends it."""
STEPS: Fineness = 3
"""Times that the torque at the output is found from the energy of springs that vary over the crank angle."""


@dataclass(frozen=True)
class GenericDrive:
    """Elements of a drive in arcmin and N m.

    Attributes
    ----------
    friction : takes its part of the torque first.
    springs : in series behind it, by what the effects of the crank angle call them.
    first_loading : factor of their twist.
    delayed : in series as well; none without.
    waves : effects of the crank angle with their amplitudes of cosine and sine.
    torque_zero : reading of the torque without load [N m].
    """

    friction: SlidingFriction
    springs: Mapping[str, Spring]
    first_loading: FirstLoading
    delayed: KelvinVoigt | None
    waves: tuple[tuple[CrankEffect, float, float], ...]
    torque_zero: float

    @classmethod
    def from_values(cls, values: Mapping[str, float], top: float) -> "GenericDrive":
        """The drive of numbers by the names of ``drive_terms``, none where not given; ``top``: largest torque [N m]."""
        amplitudes = {name: [values.get(number, 0.0) for number in TERMS[name]] for name in CRANK_EFFECTS}
        creep = values.get("creep_arcmin_per_Nm", 0.0)
        return cls(
            friction=SlidingFriction(
                values["friction_Nm"], values["load_friction"], values.get("friction_spread", 0.0)
            ),
            springs={
                "play": RoundedPlay(0.5 * values["play_arcmin"], values["knee_Nm"]),
                "compliance": LinearSpring(values["compliance_arcmin_per_Nm"]),
            },
            first_loading=FirstLoading(values.get("asymmetry", 0.0), values.get("first_loading", 0.0) / top),
            delayed=KelvinVoigt(creep, values["creep_s"]) if creep else None,
            waves=tuple((CRANK_EFFECTS[name], c, s) for name, (c, s) in amplitudes.items() if c or s),
            torque_zero=values.get("torque_zero_Nm", 0.0),
        )

    def wave(self, acts_on: str, crank: CrankAngle) -> tuple[Real | float, Real | float]:
        """Sum of the effects that act on something, and its derivative by the crank angle, each (n,) or 0."""
        wave: Real | float = 0.0
        slope: Real | float = 0.0
        for effect, cosine, sine in self.waves:
            if effect.acts_on == acts_on:
                angle, rate = (crank.disk, crank.disk_rate) if effect.per_disk else (crank.housing, 1.0)
                c, s = np.cos(effect.order * angle), np.sin(effect.order * angle)
                wave, slope = wave + cosine * c + sine * s, slope + effect.order * rate * (sine * c - cosine * s)
        return wave, slope

    def twist(self, carried: Real, factor: Real, crank: CrankAngle, motor_rate: float) -> Real:
        """Twist of the springs and angle error (n,) [arcmin] at crank angles (n,).

        Parameters
        ----------
        carried, factor : (n_stages, n) torque behind the friction of each stage [N m], as measured at the motor, and
            factor of its twist.
        motor_rate : change of the crank angle with the reading [rad/arcmin]; 0 for torques measured at the output.
        """
        error, error_slope = self.wave("angle", crank)
        waves = {name: self.wave(name, crank) for name in self.springs}
        ratio = 1 - motor_rate * error_slope
        load = carried / ratio
        varying = {name: slope for name, (_, slope) in waves.items() if motor_rate and np.any(slope)}
        for _ in range(STEPS if varying else 0):
            work = sum(slope * self.springs[name].energy(load) for name, slope in varying.items())
            along = np.sign(carried) * (carried + motor_rate * work * factor) / ratio
            load = np.sign(carried) * np.maximum(along, 0.0)
        twist = sum((1 + waves[name][0]) * spring.twist(load) for name, spring in self.springs.items())
        return np.asarray(error + np.mean(factor * twist, axis=0), float)


class LoopModel:
    """Predictions of one state's loops; keeps what friction leaves of the torque, which other numbers do not change."""

    def __init__(self, loops: CrankLoops):
        self.loops = loops
        self._carried: tuple[tuple[SlidingFriction, float] | None, Real] = None, np.empty((0, 0))
        self._zeros = loops.zeros(loops.angle)

    def predict_angle(self, values: Mapping[str, float]) -> Real:
        """Angle (n_cells,) [arcmin], each group with the zero that fits its cells best.

        Parameters
        ----------
        values : of the numbers of ``drive_terms``; those that are not given are none.
        """
        loops, drive = self.loops, GenericDrive.from_values(values, self.loops.top)
        carried = self._carried_torque(drive)
        factor = np.array([drive.first_loading.factor(torque, loops.runs) for torque in carried])
        delayed = self._delayed_twist(drive, carried)
        motor_rate, parts = loops.crank_per_output if loops.at_input else 0.0, loops.torque.shape[1]
        twist, cells = np.zeros(loops.torque.size), self._zeros
        at_start = drive.wave("reading", CrankAngle.from_readings(loops, twist))[0]
        error_at_start = np.broadcast_to(at_start, twist.shape)[::parts]
        for _ in range(ROUNDS):
            angle_before = cells
            from_start = np.repeat(self._zeros - loops.start + error_at_start, parts)
            crank = CrankAngle.from_readings(loops, from_start + twist)
            twist = drive.twist(carried, factor, crank, motor_rate) + delayed
            reading = (twist + drive.wave("reading", crank)[0]).reshape(-1, parts).mean(axis=1)
            self._zeros = loops.zeros(loops.angle - reading)
            cells = reading + self._zeros
            if np.max(np.abs(cells - angle_before)) < CLOSE or not drive.waves:
                break
        return cells

    def _carried_torque(self, drive: GenericDrive) -> Real:
        """Torque (n_stages, n_cells n_parts) [N m] behind the friction of each stage, as it is measured."""
        key = drive.friction, drive.torque_zero
        if self._carried[0] != key:
            torque = self.loops.torque.ravel() - drive.torque_zero
            self._carried = key, drive.friction.carried(torque, self.loops.runs)
        return self._carried[1]

    def _delayed_twist(self, drive: GenericDrive, carried: Real) -> Real:
        """Delayed twist (n_cells n_parts,) [arcmin] under the mean torque of the stages; none without time stamps."""
        twist = np.zeros(self.loops.torque.size)
        if drive.delayed is None or self.loops.time is None:
            return twist
        torque, time = carried.mean(axis=0), self.loops.time.ravel()
        for run in self._runs:
            twist[run] = drive.delayed.twist(Path(torque[run], time[run]))
        return twist

    @cached_property
    def _runs(self) -> tuple[Index, ...]:
        return tuple(np.flatnonzero(self.loops.runs == run) for run in np.unique(self.loops.runs))
