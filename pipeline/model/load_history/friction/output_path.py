"""Load history where friction acts on the output alone, led by its angle.

The rest of the reducer is then a nonlinear spring, its frictionless backbone, and only the rotation of the output is
left to balance: the same equilibrium as ``incremental.solve_path``, a hundred times faster. The output is turned from
bend to bend of its resistance, and the torque that it takes is read off. Between two bends the torque is linear in the
angle, so that no step has a size to choose. Where the limits of sliders fall faster than the torque carried rises, the
torque stays and the angle jumps.
"""

from typing import NamedTuple

import numpy as np

from pipeline.arrays import Real, Whole
from pipeline.model.compiled import entry, part
from pipeline.model.contact.friction_elements import Sliders

START_SHARE = 1e-9
"""Share of a slider's reach, and of a segment of the backbone, nearer than which a bend is passed already."""
MOST_STEPS = 1_000_000
"""Steps after which a path is given up: a backbone that was not solved may be of any length."""
FARTHEST_STEP = 3
"""Lengths of the backbone's end segments beyond its ends after which no balance is looked for."""


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


@part
def _resistance(angle: float, carried_torque: float, slides: _Slides, anchor: Real) -> float:
    """Torque of the sliders."""
    stiffness, limit, coefficient = slides
    resistance = 0.0
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
        step = min(step, bend / width)
    end = x + sense * step
    if abs(end - np.rint(end)) < 1e-14:
        end = np.rint(end)
    return j, x, end


@entry
def _trace_path(turns: Real, curve: tuple[Real, Real], slides: _Slides, corners: Real, corner_of_turn: Whole) -> int:
    """Corners (torque, angle, carried) of the path from turn to turn, and that of each turn; -1 if there is no room."""
    nodes, angles = curve
    anchor = np.empty(slides[0].shape[0])
    j = (nodes.shape[0] - 1) // 2
    x = 0.5 * (nodes.shape[0] - 1) - j
    angle, carried_torque = angles[j] + x * (angles[j + 1] - angles[j]), nodes[j] + x * (nodes[j + 1] - nodes[j])
    anchor[:] = angle
    total = carried_torque + _resistance(angle, carried_torque, slides, anchor)
    count, steps = 0, 0
    for t in range(turns.shape[0]):
        sense = 1.0 if turns[t] >= total else -1.0
        largest_torque, goal = sense * total, sense * turns[t]
        while sense * total < goal and -FARTHEST_STEP < x < 1 + FARTHEST_STEP:
            j, x, end = _stretch(sense, j, x, angle, carried_torque, curve, slides, anchor=anchor)
            step = angles[j] + end * (angles[j + 1] - angles[j]) - angle
            carried_step = nodes[j] + end * (nodes[j + 1] - nodes[j]) - carried_torque
            low = sense * total
            resistance = _resistance(angle + step, carried_torque + carried_step, slides, anchor)
            high = sense * (carried_torque + carried_step + resistance)
            steps += 1
            if count + 2 > corners.shape[1] or steps > MOST_STEPS:
                return -1
            share = 1.0
            target = largest_torque if low < largest_torque else goal  # thrown back before: the jump ends there
            if high >= target:
                share = (target - low) / (high - low)
                end, high = x + share * (end - x), target
            angle, carried_torque = angle + share * step, carried_torque + share * carried_step
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


def output_path(turns: Real, nodes: Real, angles: Real, sliders: Sliders) -> OutputPath:
    """The load path through ``turns``, every slider on the output.

    Parameters
    ----------
    turns : (n_turns,) [N mm], in order of time; the first is reached from rest in the middle of the play.
    nodes, angles : (n_nodes,) frictionless backbone, torque ascending; continued along its end segments.

    Raises
    ------
    ValueError
        If a slider is pressed by a contact: its slip is no function of the torque in the reducer (after a reversal the
        disk turns about where its pins stick), so only ``incremental.solve_path`` follows it.

    Notes
    -----
    Between two turns the torque is monotone, and equal at two corners where the angle jumps. Corners are exact for the
    backbone as a polyline, so that turns on the way (every row of a bench, say) change nothing. NaN where the backbone
    is not finite or the path has more steps than ``MOST_STEPS``.
    """
    if sliders.at_contacts:
        raise ValueError("a slider at a contact cannot be condensed to the output")
    sliders, turns = sliders.acting, np.asarray(turns, float)
    rising = np.maximum.accumulate(angles)
    if not np.isfinite(rising[-1]):
        return _unknown_path(len(turns))
    room = min(len(turns) * (2 * len(nodes) + 4 * len(sliders) + 8), MOST_STEPS)
    corner_of_turn = np.empty(len(turns), np.int64)
    while room <= MOST_STEPS:
        corners = np.empty((3, room))
        count = _trace_path(
            turns, (nodes, rising), (sliders.stiffness, sliders.limit, sliders.coefficient), corners, corner_of_turn
        )
        if count >= 0:
            return OutputPath(corners[:, :count], corner_of_turn)
        room *= 2
    return _unknown_path(len(turns))
