"""Load history where friction and a ripple act on the output alone, led by its angle.

The rest of the reducer is then a nonlinear spring, its frictionless backbone, and only the rotation of the output is
left to balance: the same equilibrium as ``incremental.solve_path``, a hundred times faster. The output is turned from
bend to bend of its resistance, and the torque that it takes is read off. Between two bends the torque is linear in the
angle but for the ripple, so that no step has a size to choose. Where a ripple throws the output back, the torque
stays and the angle jumps.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.arrays import Real, Whole
from pipeline.model.compiled import entry, part
from pipeline.model.contact.friction_elements import Sliders

WAVE = 32
"""Corners of a ripple's period: between two of them a chord is off by 0.5 % of the amplitude at most."""
JUMP_WAVE = 8
"""Pieces of a ripple's period while the output is thrown back, where no corner stands."""
START_SHARE = 1e-9
"""Share of a slider's reach, and of a segment of the backbone, nearer than which a bend is passed already."""
MOST_STEPS = 1_000_000
"""Steps after which a path is given up: a backbone that was not solved may be of any length."""
FARTHEST_STEP = 3
"""Lengths of the backbone's end segments beyond its ends after which no balance is looked for."""
ROOT_STEPS = 60
"""Steps of a root within a piece of a ripple at most: more than its digits."""
ROOT_SHARE = 1e-15
"""Share of the torques at the ends of a piece and of the amplitude to which its root is found."""


@dataclass(frozen=True)
class Ripple:
    """Torque [N mm] that depends on the output's angle: amplitude sin(waves angle + phase), waves per turn.

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
            raise ValueError(f"a ripple of {self.amplitude} N mm and {self.waves} waves a turn: both must be positive")


class OutputPath(NamedTuple):
    """Corners of a load path.

    Attributes
    ----------
    corners : (3, n_corners) torque [N mm], angle [rad] and torque in the reducer [N mm], in order of time.
    turns : (n_turns,) the corner at which each turn stands.
    """

    corners: Real
    turns: np.ndarray

    @property
    def at_turns(self) -> Real:
        """Angle [rad] and torque in the reducer [N mm] at the turns, (2, n_turns)."""
        return self.corners[1:, self.turns]


_Slides = tuple[Real, Real, Real]
"""Stiffness, limit and coefficient of the sliders (n_sliders,)."""
_Waves = tuple[float, float, float]
"""Amplitude, waves and phase of a ripple."""


@part
def _sine(angle: float, ripple: _Waves) -> float:
    """The ripple's torque over its amplitude; 0 without one."""
    amplitude, waves, phase = ripple
    return np.sin(waves * angle + phase) if amplitude != 0.0 else 0.0


@part
def _resistance(angle: float, carried_torque: float, slides: _Slides, ripple_torque: float, anchor: Real) -> float:
    """Torque of the sliders, and of the ripple as it is ``ripple_torque`` there."""
    stiffness, limit, coefficient = slides
    resistance = ripple_torque
    for s in range(stiffness.shape[0]):
        largest_torque = limit[s] + coefficient[s] * abs(carried_torque)
        resistance += min(max(stiffness[s] * (angle - anchor[s]), -largest_torque), largest_torque)
    return resistance


@part
def _drag(angle: float, carried_torque: float, slides: _Slides, anchor: Real) -> None:
    """Let the anchors follow where the resistance is at its limit."""
    stiffness, limit, coefficient = slides
    for s in range(stiffness.shape[0]):
        reach = (limit[s] + coefficient[s] * abs(carried_torque)) / stiffness[s]
        anchor[s] = min(max(anchor[s], angle - reach), angle + reach)


@part
def _to_bend(
    sense: float, angle: float, carried_torque: float, width: float, height: float, slides: _Slides, anchor: Real
) -> float:
    """Angle up to the next bend of the resistance on a segment of the backbone of some width and height."""
    stiffness, limit, coefficient = slides
    bend = np.inf
    to_zero = -sense * carried_torque * width / height
    unloads = to_zero > START_SHARE * width
    for s in range(stiffness.shape[0]):
        growth = coefficient[s] * height / width * (-1.0 if unloads else 1.0)
        largest_torque = limit[s] + coefficient[s] * abs(carried_torque)
        stretch = sense * stiffness[s] * (angle - anchor[s])
        if unloads and growth != 0.0:
            bend = min(bend, to_zero)
        to_slip = (largest_torque - stretch) / max(stiffness[s] - growth, 1e-300)
        if to_slip > START_SHARE * max(largest_torque / stiffness[s], width):
            bend = min(bend, to_slip)
    return bend


@part
def _stretch(
    sense: float,
    j: int,
    x: float,
    angle: float,
    carried_torque: float,
    curve: tuple[Real, Real],
    slides: _Slides,
    stride: float,
    anchor: Real,
) -> tuple[int, float, float]:
    """Segment of the backbone and place on it from where the path goes on, and the place up to which it has no bend."""
    nodes, angles = curve
    if sense > 0.0 and x >= 1.0 and j < nodes.shape[0] - 2:
        j, x = j + 1, 0.0
    elif sense < 0.0 and x <= 0.0 and j > 0:
        j, x = j - 1, 1.0
    width, height = angles[j + 1] - angles[j], nodes[j + 1] - nodes[j]
    step = 1.0 - x if sense > 0.0 else x
    if step <= 0.0:
        step = 1.0  # beyond the end
    if width > 0.0:
        bend = _to_bend(sense, angle, carried_torque, width, height, slides, anchor)
        step = min(step, min(stride, bend) / width)
    end = x + sense * step
    if abs(end - np.rint(end)) < 1e-14:
        end = np.rint(end)
    return j, x, end


@part
def _share_to_peak(
    sense: float, angle: float, turn: float, gain: float, rise: float, ripple: _Waves
) -> float:
    """Share of a piece at which a ripple, its sine rising by ``rise``, throws the output back; 1 if it does not."""
    amplitude, waves, phase = ripple
    steepest, phase_turned = amplitude * waves * abs(turn), waves * abs(turn)
    if abs(gain) > steepest * phase_turned:  # larger than what the slope varies by
        return 1.0
    steady = gain - sense * amplitude * rise
    if steepest <= abs(steady):
        return 1.0
    ahead = np.mod(np.arccos(-steady / steepest) - sense * (waves * angle + phase), 2.0 * np.pi)
    share = ahead / phase_turned
    return share if START_SHARE < share < 1.0 else 1.0


@part
def _share_to_goal(
    goal: float, low: float, high: float, sense: float, angle: float, turn: float, rise: float, ripple: _Waves
) -> float:
    """Share of a piece, from ``low`` below to ``high`` above the goal, at which the torque is the goal's.

    The ripple's sine rises by ``rise`` on it.
    """
    amplitude, waves, phase = ripple
    share = (goal - low) / (high - low)
    if amplitude == 0.0:
        return share
    steady = high - low - sense * amplitude * rise
    start, steepest = waves * angle + phase, amplitude * waves * abs(turn)
    begin = low - sense * amplitude * np.sin(start) - goal
    lower_share, upper_share, small = 0.0, 1.0, ROOT_SHARE * (abs(low) + abs(high) + amplitude)
    for _ in range(ROOT_STEPS):
        turned_phase = start + share * waves * turn
        excess = begin + share * steady + sense * amplitude * np.sin(turned_phase)
        if abs(excess) <= small:
            break
        if excess < 0.0:
            lower_share = share
        else:
            upper_share = share
        share -= excess / (steady + steepest * np.cos(turned_phase))
        if not lower_share < share < upper_share:
            share = 0.5 * (lower_share + upper_share)
    return share


@entry
def _trace_path(
    turns: Real, curve: tuple[Real, Real], slides: _Slides, ripple: _Waves, corners: Real, corner_of_turn: Whole
) -> int:
    """Corners (torque, angle, carried) of the path from turn to turn, and that of each turn; -1 if there is no room."""
    nodes, angles = curve
    anchor, wave = np.empty(slides[0].shape[0]), 2.0 * np.pi / ripple[1] if ripple[0] != 0.0 else np.inf
    j = (nodes.shape[0] - 1) // 2
    x = 0.5 * (nodes.shape[0] - 1) - j
    angle, carried_torque = angles[j] + x * (angles[j + 1] - angles[j]), nodes[j] + x * (nodes[j + 1] - nodes[j])
    anchor[:] = angle
    sine = _sine(angle, ripple)
    total = carried_torque + _resistance(angle, carried_torque, slides, ripple[0] * sine, anchor)
    count, steps = 0, 0
    for t in range(turns.shape[0]):
        sense = 1.0 if turns[t] >= total else -1.0
        largest_torque, goal = sense * total, sense * turns[t]
        while sense * total < goal and -FARTHEST_STEP < x < 1 + FARTHEST_STEP:
            stride = wave / (WAVE if sense * total >= largest_torque else JUMP_WAVE)
            j, x, end = _stretch(sense, j, x, angle, carried_torque, curve, slides, stride=stride, anchor=anchor)
            point, first_sine = (angle, carried_torque), sine
            step = angles[j] + end * (angles[j + 1] - angles[j]) - angle, nodes[j] + end * (nodes[j + 1] - nodes[j])
            step = step[0], step[1] - carried_torque
            angle, carried_torque = point[0] + step[0], point[1] + step[1]
            low, sine = sense * total, _sine(angle, ripple)
            high = sense * (carried_torque + _resistance(angle, carried_torque, slides, ripple[0] * sine, anchor))
            if ripple[0] != 0.0 and step[0] != 0.0:
                share = _share_to_peak(sense, point[0], step[0], high - low, sine - first_sine, ripple)
                if share < 1.0:
                    end, step = x + share * (end - x), (share * step[0], share * step[1])
                    angle, carried_torque = point[0] + step[0], point[1] + step[1]
                    sine = _sine(angle, ripple)
                    resistance = _resistance(angle, carried_torque, slides, ripple[0] * sine, anchor)
                    high = sense * (carried_torque + resistance)
            steps += 1
            if count + 2 > corners.shape[1] or steps > MOST_STEPS:
                return -1
            target = largest_torque if low < largest_torque else goal  # thrown back before: the jump ends there
            if high >= target:
                share = _share_to_goal(target, low, high, sense, point[0], step[0], sine - first_sine, ripple=ripple)
                end, high = x + share * (end - x), target
                angle, carried_torque = point[0] + share * step[0], point[1] + share * step[1]
                sine = _sine(angle, ripple)
            x, total, largest_torque = end, sense * high, max(largest_torque, high)
            if largest_torque <= high < goal:
                corners[0, count], corners[1, count], corners[2, count] = total, angle, carried_torque
                count += 1
            _drag(angle, carried_torque, slides, anchor)
        if count == corners.shape[1]:
            return -1
        corner_of_turn[t] = count
        corners[0, count], corners[1, count], corners[2, count] = turns[t], angle, carried_torque
        count += 1
    return count


def _unknown_path(n_turns: int) -> OutputPath:
    return OutputPath(np.full((3, n_turns), np.nan), np.arange(n_turns))


def output_path(turns: Real, nodes: Real, angles: Real, sliders: Sliders, ripple: Ripple) -> OutputPath:
    """The load path through ``turns``, every slider on the output.

    Parameters
    ----------
    turns : (n_turns,) [N mm], in order of time; the first is reached from rest in the middle of the play.
    nodes, angles : (n_nodes,) frictionless backbone, torque ascending; continued along its end segments.
    ripple : of a motor; where it is multivalued, the first balance on the way holds.

    Raises
    ------
    ValueError
        If a slider is pressed by a contact: its slip is no function of the torque in the reducer (after a reversal the
        disk turns about where its pins stick), so only ``incremental.solve_path`` follows it.

    Notes
    -----
    Between two turns the torque is monotone, and equal at two corners where the angle jumps. Corners are exact for the
    backbone as a polyline, so that turns on the way (every row of a bench, say) change nothing; between corners a
    ripple is a chord. NaN where the backbone is not finite or the path has more steps than ``MOST_STEPS``.
    """
    if sliders.at_contacts:
        raise ValueError("a slider at a contact cannot be condensed to the output")
    sliders, turns = sliders.acting, np.asarray(turns, float)
    rising = np.maximum.accumulate(angles)
    if not np.isfinite(rising[-1]):
        return _unknown_path(len(turns))
    waves = WAVE * (rising[-1] - rising[0]) * ripple.waves / (2 * np.pi) if ripple.amplitude else 0.0
    room = int(min(len(turns) * (2 * len(nodes) + 4 * len(sliders) + 2 * waves + 8), MOST_STEPS))
    corner_of_turn = np.empty(len(turns), np.int64)
    while room <= MOST_STEPS:
        corners = np.empty((3, room))
        count = _trace_path(
            turns,
            (nodes, rising),
            (sliders.stiffness, sliders.limit, sliders.coefficient),
            (ripple.amplitude, ripple.waves, ripple.phase),
            corners,
            corner_of_turn,
        )
        if count >= 0:
            return OutputPath(corners[:, :count], corner_of_turn)
        room *= 2
    return _unknown_path(len(turns))
