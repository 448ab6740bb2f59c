"""The generator's own solution of a unit on its ramps: a fine frictionless curve, with friction every row a step."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from pipeline import assembly
from pipeline.arrays import Real, Truth, Whole
from pipeline.config.studies.study import Study
from pipeline.identification.bench.load_path import Instrument, Ripple
from pipeline.identification.fitting.problem import Candidate, Model
from pipeline.identification.fitting.scaled_drives import scaled_design
from pipeline.model.contact.friction_elements import Sliders
from pipeline.model.effects.creep import KelvinVoigt
from pipeline.model.effects.effect import CYCLES
from pipeline.model.effects.hysteresis import Rayleigh
from pipeline.model.geometry.clearance import Errors
from pipeline.model.load_history.backbone import Backbone, backbone, torque_levels
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.friction.incremental import solve_path
from pipeline.model.load_history.friction.output_path import output_path
from pipeline.model.load_history.load_cycle import ARCMIN
from pipeline.model.units import NMM_PER_NM, SECONDS_AN_HOUR
from pipeline.mounting import drive_of
from tests.validation.blind.bench import Bench, Ramp

STEPS = 64
"""Nodes of the frictionless curve in each sense of the torque; with friction every row is a step."""
PLAYS = 400
"""Widths of plays that a hysteresis is summed over: its loop is off by a ten-thousandth of its size."""
BEYOND = 1.05
"""Reach of a curve over the largest torque of its load program, for noise of the torque."""
ANGLE_STEPS = 40_000
"""Steps over the range of the angle by which an output is turned against a ripple."""
UNSOUND = 1e-6
"""Relative residual of a path beyond which the unit is drawn anew."""

Outside = Callable[["Track"], Real]
"""Angle [arcmin] (n_rows,) of an effect that the library lacks."""


class UnsoundError(RuntimeError):
    """An equilibrium of the true unit was not found."""


@dataclass(frozen=True)
class Track:
    """One position of the true unit, as an effect outside the library sees it.

    Attributes
    ----------
    ramp : of the position.
    angle_at : angle [arcmin] of the unit without friction at torques (n_rows,) [N m].
    span : range of the angle [arcmin].
    crank : angle of the crank [rad].
    """

    ramp: Ramp
    angle_at: Callable[[Real], Real]
    span: float
    crank: float = 0.0


@dataclass(frozen=True)
class TrueUnit:
    """A unit as it is.

    Attributes
    ----------
    study : generating study with the unit's own numbers.
    drives : one per position, a state for every cycle.
    bench : how it is measured.
    """

    study: Study
    drives: tuple[Drive, ...]
    bench: Bench

    def angles(self, effects: Sequence[Candidate] = (), values: Sequence[float] = ()) -> list[Real]:
        """Angle [arcmin] at the rows of every position with effects of the library, before noise."""
        wears = any(CYCLES in effect.needs for effect in effects)
        states, conditions = zip(*(ramp.states(wears) for ramp in self.bench.ramps), strict=True)
        alike = [
            drive.some(np.zeros(len(of_states.cycle), int))
            for drive, of_states in zip(self.drives, conditions, strict=True)
        ]
        drives, instrument = Model(tuple(effects)).put(alike, conditions, values)
        encoder_place = encoder_places(self.bench, self.study.design.cycloid.lobes)
        turns = float(self.study.design.cycloid.lobes) if self.bench.locked == "output" else 1.0
        angles = []
        positions = zip(drives, self.bench.ramps, states, encoder_place, strict=True)
        for number, (drive, ramp, of_rows, encoder_angle) in enumerate(positions):
            ripple = instrument.ripple_at(number)
            in_space = ripple.phase + ripple.waves * float(self.bench.offset[number]) / ARCMIN  # of the angle as read
            at_output = self.bench.locked != "output"
            angle = _solved(drive, ramp, of_rows, instrument, replace(ripple, phase=in_space), at_output)
            encoder_reading = turns * angle + encoder_angle
            elapsed = ramp.time + (ramp.begin if self.bench.common else 0.0)
            read = ARCMIN * angle + instrument.drift * elapsed / SECONDS_AN_HOUR
            read += instrument.encoder[0] * np.cos(encoder_reading) + instrument.encoder[1] * np.sin(encoder_reading)
            offset = float(self.bench.offset[number])
            angles.append(with_interpolation(read + offset, instrument, number) - offset)
        return angles

    @staticmethod
    def knows(name: str) -> bool:
        """Whether the simulator has an effect of the library: this one has all."""
        return True

    def angles_outside(self, effect: Outside) -> list[Real]:
        """The same with an effect that the library lacks."""
        angles = []
        for drive, ramp, crank in zip(self.drives, self.bench.ramps, self.bench.cranks, strict=True):
            curve = _fine(drive, float(np.max(np.abs(ramp.turns))))
            single = ARCMIN * (curve.angle[0] + drive.twist(curve.torque))

            def angle_at(torque: Real, curve: Backbone = curve, single: Real = single) -> Real:
                return np.interp(NMM_PER_NM * torque, curve.torque, single)

            angles.append(effect(Track(ramp, angle_at, float(np.ptp(single)), float(np.radians(crank)))))
        return angles


def with_interpolation(read: Real, instrument: Instrument, number: int) -> Real:
    """Angles (n,) [arcmin] as an encoder reads them whose error depends on what it reads; by fixed-point steps."""
    error, phases = instrument.interpolation, (0.0, *instrument.interpolation_phases)
    phase, angle = error.phase + (phases[number] if number < len(phases) else 0.0), read
    for _ in range(60):
        angle = read + error.amplitude * np.sin(error.waves * angle / ARCMIN + phase)
    return angle


def encoder_places(bench: Bench, lobes: int) -> Real:
    """Where the encoder stands at each position [rad]: at the input if the output is locked."""
    crank = np.radians(bench.cranks)
    return crank if bench.locked == "output" else -crank / lobes


def true_unit(
    study: Study,
    keys: Sequence[str],
    scales: Sequence[float],
    errors: Errors,
    loose_um: float,
    compliances: Sequence[Real],
    bench: Bench,
) -> TrueUnit:
    """A unit of the study with its own numbers (at ``keys``, times ``scales``), errors and bearing clearance."""
    true_study = study.model_copy(update={"design": scaled_design(study.design, keys, scales)})
    softness = study.design.disk.thickness_mm / true_study.design.disk.thickness_mm
    drives = []
    one_state = Errors(**{name: value[:1] for name, value in vars(errors).items()})
    loose = assembly.bearing_clearance(true_study.design, np.array([loose_um]))
    for crank, compliance in zip(bench.cranks, compliances, strict=True):
        drives.append(drive_of(true_study, crank, softness * compliance, one_state, loose))
    return TrueUnit(true_study, tuple(drives), bench)


def _fine(drive: Drive, top: float) -> Backbone:
    reach = BEYOND * NMM_PER_NM * top / drive.rated_torque
    curve = backbone(drive.without_elements, torque_levels(STEPS, reach))
    if not np.all(curve.states.converged):
        raise UnsoundError("the frictionless curve")
    return curve


def _solved(drive: Drive, ramp: Ramp, states: Whole, instrument: Instrument, ripple: Ripple, at_output: bool) -> Real:
    """Angle [rad] at the rows of a ramp, each in its state, that loads the output, or the input of a locked output."""
    turns, true_torque = instrument.true_torque(ramp.turns), instrument.true_torque(ramp.torque)
    if instrument.torque_creep[0]:
        delayed = _crept(instrument.delayed_reading, true_torque, ramp.time)
        last_rows = np.searchsorted(ramp.leg, np.arange(len(turns))) - 1  # before each turn; -1 for the first
        turns, true_torque = turns - np.where(last_rows < 0, 0.0, delayed[last_rows]), true_torque - delayed
    curve = _fine(drive, float(np.max(np.abs(turns))) / NMM_PER_NM)
    angle, carried_torque = np.empty(len(true_torque)), np.empty(len(true_torque))
    for state in range(len(curve.angle)):
        of_state = states == state
        levels = drive.stiffening(state) * curve.torque
        elastic_angle = curve.angle[state]
        if ripple.amplitude or len(drive.sliders.acting):
            steps, is_row = _every_row(turns, true_torque, ramp.leg)
            if drive.sliders.at_contacts:
                output_angle, play_torque = _followed(drive, state, curve, steps)
            else:
                leaning = 1 + drive.lean
                sliders = drive.sliders.of_scaled_load(leaning)
                at_rows = (
                    turned_in_small_steps(steps, leaning * levels, elastic_angle, sliders, ripple)
                    if ripple.amplitude
                    else output_path(steps, leaning * levels, elastic_angle, sliders).at_turns
                )
                output_angle, play_torque = at_rows[0], at_rows[1] / leaning
            angle[of_state], carried_torque[of_state] = output_angle[is_row][of_state], play_torque[is_row][of_state]
        else:
            angle[of_state], carried_torque[of_state] = (
                np.interp(true_torque[of_state], levels, elastic_angle),
                true_torque[of_state],
            )
    in_series = true_torque if at_output else carried_torque
    angle = angle + drive.twist(in_series)
    for element in drive.hystereses:
        angle = angle + SECOND_SOLUTIONS[type(element)](element, in_series, ramp.time)
    return angle


def turned_in_small_steps(
    torques: Real, nodes: Real, angles: Real, sliders: Sliders, ripple: Ripple | None = None
) -> Real:
    """Angle [rad] and torque in the reducer [N mm] (2, n_torques) where each torque (n_torques,) [N mm] is first met.

    The output is turned in small steps of its angle from the middle of the backbone (nodes, angles): each slider is a
    stop operator, which adds stiffness times the angle to its resistance and cuts it off at the limit of the moment. A
    motor's torque has to overcome the ripple besides, which may throw the output back: its angle then jumps.
    """
    acting, ripple = sliders.acting, ripple or Ripple()
    columns = np.column_stack([acting.stiffness, acting.limit, acting.coefficient])
    waves = np.array([ripple.amplitude, ripple.waves, ripple.phase])
    return np.asarray(_turned(np.asarray(torques, float), nodes, angles, columns, waves, np.ptp(angles) / ANGLE_STEPS))


@njit
def _taken(angle, rotation, nodes, angles, columns, waves, before, after):  # type: ignore[no-untyped-def]
    """Torque at an angle, and in the reducer; the resistance of the sliders from ``before`` goes into ``after``."""
    j = min(max(np.searchsorted(angles, angle) - 1, 0), len(angles) - 2)
    carried = nodes[j] + (angle - angles[j]) * (nodes[j + 1] - nodes[j]) / (angles[j + 1] - angles[j])
    total = carried + waves[0] * np.sin(waves[1] * angle + waves[2])
    for k in range(len(columns)):
        largest = columns[k, 1] + columns[k, 2] * abs(carried)
        after[k] = min(max(before[k] + columns[k, 0] * rotation, -largest), largest)
        total += after[k]
    return total, carried


@njit
def _turned(torques, nodes, angles, columns, waves, step):  # type: ignore[no-untyped-def]
    """See ``turned_in_small_steps``."""
    points, resistance, ahead = np.empty((2, len(torques))), np.zeros(len(columns)), np.zeros(len(columns))
    angle = 0.5 * (angles[(len(angles) - 1) // 2] + angles[len(angles) // 2])
    total, carried = _taken(angle, 0.0, nodes, angles, columns, waves, resistance, ahead)
    for number, torque in enumerate(torques):
        sense = 1.0 if torque > total else -1.0
        while sense * (torque - total) > 0:
            rotation = sense * step
            reached, carried = _taken(angle + rotation, rotation, nodes, angles, columns, waves, resistance, ahead)
            if sense * (reached - torque) >= 0:
                rotation *= (torque - total) / (reached - total)
                reached, carried = _taken(angle + rotation, rotation, nodes, angles, columns, waves, resistance, ahead)
                reached = torque
            angle, total = angle + rotation, reached
            resistance[:] = ahead
        points[:, number] = angle, carried
    return points


def _plays(element: Rayleigh, torque: Real, time: Real) -> Real:
    """Twist [rad] of a Rayleigh hysteresis along torques (n_rows,) [N mm] as the sum of plays of every width."""
    half = np.max(np.abs(torque)) * (np.arange(PLAYS) + 0.5) / PLAYS
    play_torque, twist = np.zeros(PLAYS), np.empty(len(torque))
    for k, load in enumerate(torque):
        play_torque = np.clip(play_torque, load - half, load + half)
        twist[k] = play_torque.sum()
    return 2 * element.coefficient * float(half[1] - half[0]) * twist


def _every_row(turns: Real, row_torque: Real, leg: Whole) -> tuple[Real, Truth]:
    """Torques of all rows with the turns between them, and which of them are rows."""
    parts = [turns[:1], *(np.append(row_torque[leg == k], end) for k, end in enumerate(turns[1:]))]
    is_row = [np.append(np.ones(len(part) - 1, bool), False) for part in parts]
    return np.concatenate(parts), np.concatenate(is_row)


def _followed(drive: Drive, state: int, curve: Backbone, steps: Real) -> tuple[Real, Real]:
    """Angle [rad] and torque in the reducer [N mm] along a history with friction at contacts, in one state."""
    motion, _, worst = solve_path(
        drive, state, steps, (curve.torque, curve.states.motion[state], curve.states.force[state])
    )
    if worst > UNSOUND:
        raise UnsoundError("the path with friction")
    output_angle = motion[:, drive.reducer.output_motion]
    return output_angle, np.interp(output_angle, curve.angle[state], curve.torque)


def _crept(element: KelvinVoigt, carried_torque: Real, time: Real) -> Real:
    """Delayed rotation [rad] for a torque that is linear between rows."""
    crept, strain = np.zeros_like(carried_torque), 0.0
    for k in range(1, len(carried_torque)):
        step = (time[k] - time[k - 1]) / element.time_constant
        decay = np.exp(-step)
        torque_before, torque_after = carried_torque[k - 1], carried_torque[k]
        slope = (torque_after - torque_before) / step if step > 0 else 0.0
        strain = strain * decay + element.compliance * (torque_after - slope + (slope - torque_before) * decay)
        crept[k] = strain
    return crept


SECOND_SOLUTIONS: dict[type, Callable[..., Real]] = {KelvinVoigt: _crept, Rayleigh: _plays}
"""Rotation [rad] at rows of elements with memory, by other code than theirs: element, torque carried, time [s]."""
