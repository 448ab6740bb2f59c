"""The way of a drive through the torques of a position: elastic curve, friction, and memory in series."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from pipeline.arrays import Real, Truth, Whole
from pipeline.constant_kinds import Fineness, Grid, Rounding, Shortcut
from pipeline.identification.bench.course import Course, slid_torque
from pipeline.model.effects.creep import KelvinVoigt
from pipeline.model.elements import Path, merged_path
from pipeline.model.load_history.backbone import NO_LOAD, Backbone
from pipeline.model.load_history.cell_means import mean_torque, means, means_along
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.friction.incremental import solve_path
from pipeline.model.load_history.friction.output_path import output_path
from pipeline.model.units import ARCMIN, NMM_PER_NM, SECONDS_AN_HOUR

RIPPLE_PHASES: Grid = (-1.2, -0.6, -0.2, 0.0, 0.2, 0.6, 1.2)
"""Phases [rad] from that of the angle measured, between which the angle of a balance is searched for."""
RIPPLE_STEPS: Fineness = 2
"""Steps of the search between two of them, after a secant."""
STEEP: Rounding = 0.1
"""Least derivative of the torque read by the torque in the drive: a ripple makes it zero where it throws the output
back, and the derivatives of the angle, which are divided by it, infinite."""
Torques = tuple[Real, Real]
"""Torques at the turns (n_turns,) and within the cells (n_cells, n_edges) [N mm]."""

AFTER_TURNS: Grid = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0, 10.0, 14.0)
"""Further steps of the path after a turn of the torque, as multiples of the torque that friction resists there. The
contacts slip one by one soon after the turn, and the nodes are far apart at large torques."""
REPEATED_SHARE: Shortcut = 0.01
"""Share of the range of torque within which two turns are the same: friction then repeats its last loop."""
LARGEST_RESIDUAL: Rounding = 1e-3
"""Relative residual of an equilibrium that is none."""


@dataclass(frozen=True)
class Ripple:
    """Torque [N mm], or error of a reading [arcmin], that depends on the angle measured.

    It is amplitude sin(waves angle + phase), waves per turn of the output.

    Raises
    ------
    ValueError
        If the amplitude is negative or the number of waves is not positive.
    """

    amplitude: float = 0.0
    waves: float = 1.0
    phase: float = 0.0

    def __post_init__(self) -> None:
        if self.amplitude < 0 or self.waves <= 0:
            raise ValueError(f"a ripple of {self.amplitude} and {self.waves} waves a turn: both must be positive")

    def value(self, angle: Real) -> Real:
        """Its value at angles of any shape [rad]."""
        return self.amplitude * np.sin(self.waves * angle + self.phase)

    def slope(self, angle: Real) -> Real:
        """Its derivative by the angle at angles of any shape [rad]."""
        return self.amplitude * self.waves * np.cos(self.waves * angle + self.phase)

    def balances(self, slope: Real) -> Real:
        """Angles of balance at one torque where the drive turns by ``slope`` (n,) [rad/(N mm)], mean over the phases.

        Those of x + b sin(x + phase) = 0 number the mean of |1 + b cos| over a period (Kac, Bull. Amer. Math. Soc. 49
        (1943) 314): one up to b = 1.
        """
        steepness = np.maximum(np.abs(slope) * self.amplitude * self.waves, 1.0)
        return np.asarray(2 / np.pi * (np.sqrt(steepness**2 - 1) + np.arcsin(1 / steepness)))


def _at_position(ripple: Ripple, phases: tuple[float, ...], position: int) -> Ripple:
    """A ripple with the phase that it has at a position, by its phases at further positions than the first."""
    return ripple if not phases or not position else replace(ripple, phase=ripple.phase + phases[position - 1])


@dataclass(frozen=True)
class Instrument:
    """The bench as it reads: torque (1 + gain) (T + creep) + zero, angle with drift and its encoder's eccentricity.

    Attributes
    ----------
    torque_zero : [N m]
    torque_gain : [-]
    torque_creep : share of the torque that is read again with a first-order delay, and its time constant [s].
    drift : [arcmin/h]
    encoder : amplitudes (cosine, sine) of the encoder's eccentricity [arcmin].
    ripple : torque that is read in addition to that in the drive; it depends on the angle measured.
    ripple_phases : (n_positions - 1,) its phases at further positions less that at the first [rad]; none: all alike.
    interpolation, interpolation_phases : the same of what the encoder reads too much within a period of its signal.
    """

    torque_zero: float = 0.0
    torque_gain: float = 0.0
    torque_creep: tuple[float, float] = (0.0, 1.0)
    drift: float = 0.0
    encoder: tuple[float, float] = (0.0, 0.0)
    ripple: Ripple = field(default_factory=Ripple)
    ripple_phases: tuple[float, ...] = ()
    interpolation: Ripple = field(default_factory=Ripple)
    interpolation_phases: tuple[float, ...] = ()

    def ripple_at(self, position: int) -> Ripple:
        """The ripple with the phase that it has at a position."""
        return _at_position(self.ripple, self.ripple_phases, position)

    def interpolation_error(self, course: Course, position: int) -> Real | float:
        """Mean error of the reading over each cell (n_cells,) [arcmin] at a position; 0 without one."""
        error = _at_position(self.interpolation, self.interpolation_phases, position)
        if not error.amplitude or course.rows is None:
            return 0.0
        return mean_torque(error.value(course.rows[1] / ARCMIN))

    def true_torque(self, read: Real) -> Real:
        """Torque [N mm] that is read as ``read`` [N m]; what a creep of the sensor adds is not yet subtracted."""
        return NMM_PER_NM * (read - self.torque_zero) / (1 + self.torque_gain)

    @property
    def delayed_reading(self) -> KelvinVoigt:
        """What a creep of the sensor adds to its reading, as a function of the reading: an element with a delay.

        The sensor reads r = T + c y of the torque T, with the share c and the delay y' = (T - y) / tau. So c y follows
        r as a delayed twist follows a torque, with the share c / (1 + c) and the time constant tau / (1 + c).
        """
        share, time_constant = self.torque_creep
        return KelvinVoigt(share / (1 + share), time_constant / (1 + share))

    def torques(self, course: Course) -> Torques:
        """Torques in the drive along a course [N mm]; a ripple is not yet subtracted."""
        turns, edges = self.true_torque(course.torque), self.true_torque(course.cell_torques)
        if not self.torque_creep[0]:
            return turns, edges
        if course.readings is None or course.edge_times is None:
            of_cells = mean_torque(edges)
            path, of_cell = merged_path(turns, of_cells, course.leg, course.time)
            crept = self.delayed_reading.twist(path)
            return turns - np.delete(crept, of_cell), edges - crept[of_cell, None]
        time, torque = course.readings[0], self.true_torque(course.readings[1])
        of_edges = np.interp(course.edge_times, time, self.delayed_reading.twist(Path(torque, time)))
        return turns - of_edges[course.edges_beside_turns], edges - of_edges

    def angle_read(self, course: Course, angle: Real, encoder_place: float) -> Real:
        """Angle [arcmin] that is read where the output stands at ``angle`` (n_cells,) [rad]."""
        read = ARCMIN * angle + self.drift * course.time / SECONDS_AN_HOUR
        if any(self.encoder):
            turns = course.encoder_turns * angle + encoder_place
            read += self.encoder[0] * np.cos(turns) + self.encoder[1] * np.sin(turns)
        return read


@dataclass(frozen=True)
class LoadPath:
    """What a position went through.

    Attributes
    ----------
    angle : (n_cells,) of the output [rad].
    slope : (n_cells,) d angle / d torque [rad/(N mm)].
    carried_torque : (n_cells,) torque behind friction [N mm]: that of the elastic curve's nodes.
    at_turns : (n_turns,) the same at the turns.
    is_in_range : whether a crank that turns stays between the angles at which drives were made.
    """

    angle: Real
    slope: Real
    carried_torque: Real
    at_turns: Real
    is_in_range: bool = True


class ElasticCurve(NamedTuple):
    """What a reducer turns by without friction, in one state.

    Attributes
    ----------
    torque : (n_nodes,) ascending, as the bench reads it without friction [N mm].
    angle : (n_nodes,) of the turning end [rad]; with what is in series only where the crank turns.
    carried_torque : (n_nodes,) torque in the reducer [N mm]; the same, but where the motor is read and its crank turns.
    """

    torque: Real
    angle: Real
    carried_torque: Real

    def torque_carried(self, torque: Real) -> Real:
        """Torque in the reducer [N mm] at torques of any shape behind friction, within the curve."""
        return torque if self.carried_torque is self.torque else np.interp(torque, self.torque, self.carried_torque)


class Elastic:
    """Elastic curves of a reducer whose crank is held, one for each of its states."""

    def __init__(self, drive: Drive, curve: Backbone):
        self.drive, self.curve = drive, curve

    def curve_of_state(self, state: int) -> ElasticCurve:
        """The curve of a state."""
        nodes = self.drive.stiffening(state) * self.curve.torque
        return ElasticCurve(nodes, self.curve.angle[state], nodes)


def load_path(
    drive: Drive, course: Course, curve: Backbone, elastic: Elastic, torque: Real
) -> tuple[Callable[[Real], LoadPath], bool]:
    """The way through the torques at the turns (n_turns,) [N mm], without what springs with memory add.

    Returns
    -------
    The way as a function of the torques within the cells (n_cells, n_edges) [N mm]; and whether every equilibrium was
    found.
    """
    if course.sliding is not None:
        return partial(_slid, drive, course, curve, torque), True
    if len(drive.sliders.acting):
        return _along(drive, course, curve, elastic, torque)
    return partial(_frictionless_path, course, elastic, torque), True


def _along(
    drive: Drive, course: Course, curve: Backbone, elastic: Elastic, torque: Real
) -> tuple[Callable[[Real], LoadPath], bool]:
    """The way with friction; whether it is sound."""
    nodes, sound = curve.torque, True
    at_turns, ways = torque.copy(), []
    repeated_torque = np.arange(len(torque) - 1)
    if drive.sliders.at_contacts and (drive.lean or course.crank):
        return partial(_means_of_ways, course, [], at_turns), False  # not solved together: no number
    if drive.sliders.at_contacts:
        repeated_torque = _repeats(torque)
        loads = np.sign(nodes) * np.maximum(np.abs(nodes), NO_LOAD * drive.rated_torque)  # ends of play carry none
        followed_torque = torque[: repeated_torque.max() + 2]
        steps, turns = _steps(followed_torque, loads, drive.sliders.resisted(followed_torque))
    for state in course.states:
        stiffer = drive.stiffening(state)
        if drive.sliders.at_contacts:
            seeds = (nodes, curve.states.motion[state], curve.states.force[state])
            motions, _, largest_residual = solve_path(drive.at_drawing_modulus(state), state, steps / stiffer, seeds)
            output_angle = motions[:, drive.reducer.output_motion]
            corners, sound = np.array([steps, output_angle, steps]), sound and largest_residual <= LARGEST_RESIDUAL
        else:
            leaning, of_state = 1 + drive.lean, elastic.curve_of_state(state)
            sliders = drive.sliders.of_scaled_load(leaning)
            corners, turns = output_path(torque, leaning * of_state.torque, of_state.angle, sliders)
            corners[2] /= leaning
        in_state = course.state_of_legs == state
        ends = np.column_stack([turns[repeated_torque], turns[repeated_torque + 1], course.sense])
        at_turns[1:][in_state] = corners[2, ends[in_state, 1]]
        at_turns[:-1][in_state] = corners[2, ends[in_state, 0]]
        ways.append((state, corners, ends))
    return partial(_means_of_ways, course, ways, at_turns), sound


def _means_of_ways(course: Course, ways: Sequence[tuple[int, Real, Whole]], at_turns: Real, edges: Real) -> LoadPath:
    """Means over the cells, of each state (number, corners of its way, ends of its legs); NaN without a way."""
    total = np.full((2, 2, len(edges)), 0.0 if ways else np.nan)
    for state, corners, ends in ways:
        of_state, share = np.zeros_like(total), course.share_of(state)
        means_along(edges, course.leg, corners, ends, share > 0, *of_state)
        total += share * of_state
    (angle, carried_torque), (slope, _) = total
    return LoadPath(angle, slope, carried_torque, at_turns)


def _frictionless_path(course: Course, elastic: Elastic, torque: Real, edges: Real) -> LoadPath:
    """The way without friction: the elastic curve, wherever it is."""
    angle_and_slope = np.zeros((2, len(edges)))
    for state in course.states:
        share, of_state = course.share_of(state), elastic.curve_of_state(state)
        cells = share > 0
        angle_and_slope[:, cells] += share[cells] * means(edges[cells], of_state.torque, of_state.angle)
    return LoadPath(angle_and_slope[0], angle_and_slope[1], mean_torque(edges), torque)


def with_springs(drive: Drive, course: Course, curve: Backbone, path: LoadPath, torques: Torques) -> LoadPath:
    """A way with the twist of springs and of elements with memory, which are in series with the output.

    On a loaded output they carry all of the torque; at a locked output they carry what friction leaves of it.
    """
    turns, edges = torques
    if course.is_output_locked:
        turns, edges = path.at_turns, np.repeat(path.carried_torque[:, None], 2, axis=1)
    angle, slope = path.angle, path.slope
    if drive.springs:
        twist, rise = means(edges, curve.torque, drive.twist(curve.torque))
        angle, slope = angle + twist, slope + rise
    if drive.hystereses:
        angle = angle + memory_twist(drive, course, (turns, mean_torque(edges)))
    return replace(path, angle=angle, slope=slope)


def memory_twist(drive: Drive, course: Course, torques: Torques) -> Real:
    """Rotation (n_cells,) [rad] of the elements with memory under torques of turns and of cells (n_cells,) [N mm]."""
    along, points = merged_path(*torques, course.leg, course.time)
    return np.asarray(sum(element.twist(along) for element in drive.hystereses))[points]


def _slid(drive: Drive, course: Course, curve: Backbone, torque: Real, edges: Real) -> LoadPath:
    """The way of an output that slides all along in one sense at each cell: see ``slid_torque``."""
    assert course.sliding is not None
    (angle, slope, carried_torque), leaning = np.zeros((3, len(edges))), 1 + drive.lean
    for state in course.states:
        share_of_state = course.share_of(state)
        cells = share_of_state > 0
        weight = share_of_state[cells]
        nodes = leaning * drive.stiffening(state) * curve.torque
        edges_carried, share = slid_torque(edges[cells], course.sliding[cells], drive.sliders.of_scaled_load(leaning))
        of_state, rise = means(edges_carried, nodes, curve.angle[state])
        angle[cells] += weight * of_state
        slope[cells] += weight * rise * share
        carried_torque[cells] += weight * mean_torque(edges_carried) / leaning
    return LoadPath(angle, slope, carried_torque, torque)


def _steps(torque: Real, nodes: Real, resisted_torque: Real) -> tuple[Real, Whole]:
    """Torques from turn to turn over the nodes, and the step at which each turn stands.

    After a turn a few more at multiples of the torque (n_turns,) that friction resists there.
    """
    parts, starts, count = [torque[:1]], [0], 1
    for start, end, resisted in zip(torque[:-1], torque[1:], resisted_torque[:-1], strict=True):
        after_turn = start + np.sign(end - start) * resisted * np.array(AFTER_TURNS)
        known_torques = np.union1d(nodes, after_turn)
        interval = known_torques[(known_torques > min(start, end)) & (known_torques < max(start, end))]
        parts.append(np.append(interval if end > start else interval[::-1], end))
        count += len(parts[-1])
        starts.append(count - 1)
    return np.concatenate(parts), np.array(starts)


def _repeats(torque: Real) -> Whole:
    """For each leg the earlier one that it repeats, turns before it included, or itself (n_legs,)."""
    close = REPEATED_SHARE * np.ptp(torque)
    repeated_torque = np.arange(len(torque) - 1)
    for leg in range(3, len(repeated_torque)):
        is_repeated = np.all(np.abs(torque[leg - 1 : leg + 1] - torque[leg - 3 : leg - 1]) <= close)
        ends = np.sign(torque[leg + 1] - torque[leg]) * (torque[leg + 1] - torque[leg - 1])
        if is_repeated and ends <= close:
            repeated_torque[leg] = repeated_torque[leg - 2]
        else:
            repeated_torque[: leg + 1] = np.arange(leg + 1)  # its history must be followed
    return repeated_torque


def read_with_ripple(
    ripple: Ripple, course: Course, edges: Real, read_at: Callable[[Real], tuple[Real, LoadPath, bool]]
) -> tuple[Real, LoadPath, bool, Real]:
    """Prediction where a ripple of the torque depends on the angle itself: the balance nearest to the angle measured.

    At one torque read there may be several angles at which drive and ripple are in balance. A bench that turns the
    output steadily passes all of them; one that raises the torque jumps over some. The angle measured with the torque
    tells which one holds.

    Parameters
    ----------
    edges : (n_cells, n_edges) torques within the cells, the ripple included [N mm].
    read_at : angle (n_cells,) [arcmin], way, and whether all of it was found, at torques without the ripple (n_cells,
        n_edges) [N mm].

    Returns
    -------
    Angle (n_cells,) [arcmin]; way; whether it was found; and change of the angle (n_cells,) for a change of the curve.
    Where there is no balance within ``RIPPLE_PHASES`` the ripple acts at the angle measured.
    """
    assert course.rows is not None
    measured = course.rows[1]
    middle = measured.mean(axis=1)

    def read(shift: Real) -> tuple[Real, LoadPath, bool, Real]:
        angle, path, is_sound = read_at(edges - ripple.value((measured + shift[:, None]) / ARCMIN))
        return angle, path, is_sound, 1 + path.slope * ripple.slope((middle + shift) / ARCMIN)

    unmoved, *_ = read(np.zeros(len(middle)))
    zero = float(np.median(middle - unmoved))

    def excess(shift: Real) -> tuple[Real, Real]:
        angle, *_, rise = read(shift)
        return np.asarray(middle + shift - zero - angle), rise

    shifts = np.array(RIPPLE_PHASES) * ARCMIN / ripple.waves
    excesses = [excess(np.full(len(middle), shift))[0] if shift else middle - zero - unmoved for shift in shifts]
    root, is_found = _nearest_root(excess, shifts, np.array(excesses))
    angle, path, is_sound, rise = read(root)
    response = np.where(is_found, np.sign(rise) / np.maximum(np.abs(rise), STEEP), 1.0)
    return np.where(is_found, middle + root - zero, angle), path, is_sound, response


def _nearest_root(function: Callable[[Real], tuple[Real, Real]], places: Real, values: Real) -> tuple[Real, Truth]:
    """Root (n,) nearest to zero of a function of (n,), and whether there is one between ``places`` (n_places,).

    The function returns its values and derivatives; ``values`` (n_places, n) are those at the places. After a secant
    come steps of Newton's that stay between the ends; where one does not, half of the way takes its place.
    """
    changes_sign = np.sign(values[1:]) != np.sign(values[:-1])
    distance = np.where(changes_sign, np.abs(places[1:] + places[:-1])[:, None], np.inf)
    interval, numbers = np.argmin(distance, axis=0), np.arange(values.shape[1])
    is_found = np.isfinite(distance[interval, numbers])
    low, high = places[interval], places[interval + 1]
    low_value, high_value = values[interval, numbers], values[interval + 1, numbers]
    root = low + low_value / np.where(is_found, low_value - high_value, 1.0) * (high - low)
    for _ in range(RIPPLE_STEPS):
        value, rise = function(root)
        is_low = np.sign(value) == np.sign(low_value)
        low, high = np.where(is_low, root, low), np.where(is_low, high, root)
        newton = root - value / np.where(np.abs(rise) < 1e-9, 1e-9, rise)
        root = np.where((newton >= low) & (newton <= high), newton, 0.5 * (low + high))
    return np.where(is_found, root, 0.0), is_found  # 0 where there is none
