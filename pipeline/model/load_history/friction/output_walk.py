"""Load history where friction and ripple act on the output alone, led by its angle.

The same equilibrium as ``output_path.condensed_path``. There a balance is looked for at every torque; here the output
is turned from bend to bend of its resistance, and the torque that it takes is read off: no iteration, and what the
curve is between any two torques is known. Where a ripple throws the output back, the torque stays and the angle jumps.
"""

import numpy as np

from pipeline.model.compiled import entry, part
from pipeline.model.contact.friction_elements import Sliders
from pipeline.model.geometry.cycloid_profile import Real
from pipeline.model.load_history.friction.output_path import Ripple

WAVE = 32
"""Corners of a ripple's period: a chord is off by 0.5 % of the amplitude at most."""
STARTED = 1e-9
"""Share of a slider's reach, and of a segment of the backbone, nearer than which it slides already."""
MOST_STEPS = 1_000_000
"""Steps after which a way is given up: a backbone that was not solved may be of any length."""
FAR = 3
"""Lengths of the backbone beyond its ends after which no balance is looked for."""


@part
def _resists(angle, carried_torque, slides, ripple, anchor):
    """Torque of the sliders and the ripple."""
    stiffness, limit, coefficient = slides
    amplitude, waves, phase = ripple
    added = amplitude * np.sin(waves * angle + phase) if amplitude != 0.0 else 0.0
    for s in range(stiffness.shape[0]):
        largest = limit[s] + coefficient[s] * abs(carried_torque)
        added += min(max(stiffness[s] * (angle - anchor[s]), -largest), largest)
    return added


@part
def _follow_on(angle, carried_torque, slides, anchor):
    """Let the anchors follow where the resistance is at its limit."""
    stiffness, limit, coefficient = slides
    for s in range(stiffness.shape[0]):
        reach = (limit[s] + coefficient[s] * abs(carried_torque)) / stiffness[s]
        anchor[s] = min(max(anchor[s], angle - reach), angle + reach)


@part
def _free_way(sense, angle, carried_torque, width, height, slides, ripple, anchor):
    """Angle up to the next bend of the resistance on a segment of the backbone of some width and height."""
    stiffness, limit, coefficient = slides
    length = np.inf
    if ripple[0] != 0.0:
        length = 2.0 * np.pi / (abs(ripple[1]) * WAVE)
    for s in range(stiffness.shape[0]):
        grows = coefficient[s] * height / width * sense * (1.0 if carried_torque >= 0.0 else -1.0)
        largest = limit[s] + coefficient[s] * abs(carried_torque)
        to_slip = (largest - sense * stiffness[s] * (angle - anchor[s])) / max(stiffness[s] - grows, 1e-300)
        if to_slip > STARTED * max(largest / stiffness[s], width):
            length = min(length, to_slip)
    return length


@part
def _stretch(sense, j, x, angle, carried_torque, curve, slides, ripple, anchor):
    """Segment of the backbone and place on it from where the way goes on, and the place up to which it has no bend."""
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
        step = min(step, _free_way(sense, angle, carried_torque, width, height, slides, ripple, anchor) / width)
    end = x + sense * step
    if abs(end - np.rint(end)) < 1e-14:
        end = np.rint(end)
    return j, x, end


@entry
def _walked(turns, curve, slides, ripple, corners, starts):
    """Corners (torque, angle, carried) of the way from turn to turn, and the first of each; -1 if there is no room."""
    nodes, angles = curve
    anchor = np.empty(slides[0].shape[0])
    j = (nodes.shape[0] - 1) // 2
    x = 0.5 * (nodes.shape[0] - 1) - j
    angle, carried_torque = angles[j] + x * (angles[j + 1] - angles[j]), nodes[j] + x * (nodes[j + 1] - nodes[j])
    anchor[:] = angle
    total = carried_torque + _resists(angle, carried_torque, slides, ripple, anchor)
    count, steps = 0, 0
    for t in range(turns.shape[0]):
        sense = 1.0 if turns[t] >= total else -1.0
        largest_torque, goal = sense * total, sense * turns[t]
        while sense * total < goal and -FAR < x < 1 + FAR:
            j, x, end = _stretch(sense, j, x, angle, carried_torque, curve, slides, ripple, anchor)
            width, height = angles[j + 1] - angles[j], nodes[j + 1] - nodes[j]
            next_angle, next_carried = angles[j] + end * width, nodes[j] + end * height
            total_after = next_carried + _resists(next_angle, next_carried, slides, ripple, anchor)
            low, high = sense * total, sense * total_after
            steps += 1
            if count + 3 > corners.shape[1] or steps > MOST_STEPS:
                return -1
            if low < largest_torque < high:  # thrown back before: the jump ends here
                share = (largest_torque - low) / (high - low)
                corners[0, count] = sense * largest_torque
                corners[1, count] = angle + share * (next_angle - angle)
                corners[2, count] = carried_torque + share * (next_carried - carried_torque)
                count += 1
            if high >= goal:
                share = (goal - low) / (high - low)
                end = x + share * (end - x)
                next_angle, next_carried = (
                    angle + share * (next_angle - angle),
                    carried_torque + share * (next_carried - carried_torque),
                )
                total_after = turns[t]
            elif high > largest_torque:
                corners[0, count], corners[1, count], corners[2, count] = total_after, next_angle, next_carried
                count += 1
            largest_torque = max(largest_torque, high)
            x, angle, carried_torque, total = end, next_angle, next_carried, total_after
            _follow_on(angle, carried_torque, slides, anchor)
        if count == corners.shape[1]:
            return -1
        starts[t] = count
        corners[0, count], corners[1, count], corners[2, count] = turns[t], angle, carried_torque
        count += 1
    return count


def walked(turns: Real, nodes: Real, angles: Real, sliders: Sliders, ripple: Ripple) -> tuple[Real, np.ndarray]:
    """Corners of the way through ``turns``: torque [N mm], angle [rad], torque in the reducer [N mm], (3, n_corners).

    Parameters
    ----------
    turns : (n_turns,) [N mm]; the first is reached from rest in the middle of the play.
    nodes, angles : (n_nodes,) frictionless backbone, torque ascending; continued along its end segments.
    sliders : on the output; one pressed by a contact cannot be condensed to it (``output_path.condensed_path``).

    Returns
    -------
    And the corner at which each turn stands (n_turns,). Between two turns the torque is monotone, and equal at two
    corners where the angle jumps. Exact for the backbone as a polyline but for the chords of a ripple. NaN where the
    backbone is not finite or the way has more steps than ``MOST_STEPS``.
    """
    sliders = sliders.acting
    rising = np.maximum.accumulate(angles)
    no_corners = np.full((3, len(turns)), np.nan), np.arange(len(turns))
    if not np.all(np.isfinite(rising)):
        return no_corners
    waves = WAVE * np.ptp(rising) * abs(ripple.waves) / (2 * np.pi) if ripple.amplitude else 0.0
    room = int(min(len(turns) * (2 * len(nodes) + 4 * len(sliders) + 2 * waves + 8), MOST_STEPS))
    starts = np.empty(len(turns), np.int64)
    while room <= MOST_STEPS:
        corners = np.empty((3, room))
        count = _walked(
            np.asarray(turns, float),
            (nodes, rising),
            (sliders.stiffness, sliders.limit, sliders.coefficient),
            (ripple.amplitude, ripple.waves, ripple.phase),
            corners,
            starts,
        )
        if count >= 0:
            return corners[:, :count], starts
        room *= 2
    return no_corners
