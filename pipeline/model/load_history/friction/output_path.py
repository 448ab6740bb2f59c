"""Equilibria along a load history where friction acts on the output alone.

The rest of the reducer is then a nonlinear spring, its frictionless backbone, and only the rotation of the output is
left to balance: the same equilibrium as ``incremental.solve_path``, a hundred times faster.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.model.compiled import entry, part
from pipeline.model.contact.friction_elements import Sliders
from pipeline.model.geometry.cycloid_profile import Real

ROOT_STEPS = 80
"""Bisections of an angle at most: more than its digits."""
ROOT_SHARE = 1e-13
"""Share of the range of torque to which the output is balanced."""
FAR = 3
"""Lengths of the backbone beyond its ends after which no balance is looked for."""
MOST_LOOKS = 2000
"""Strides from one load step to the next after which no balance is looked for."""
RIPPLE_SCAN = 24
"""Points of a ripple's period at which the first balance along the way is looked for."""


@dataclass(frozen=True)
class Ripple:
    """Torque [N mm] that depends on the output's angle: amplitude sin(waves angle + phase), waves per radian."""

    amplitude: float = 0.0
    waves: float = 1.0
    phase: float = 0.0


@part
def _resistance(position, curve, slides, ripple, anchor):
    """Angle, torque of the backbone and all that sliders and ripple add, at a place along the backbone's nodes."""
    nodes, angles = curve
    stiffness, limit, coefficient = slides
    j = min(max(int(position), 0), nodes.shape[0] - 2)
    x = position - j
    angle = angles[j] + x * (angles[j + 1] - angles[j])
    carried_torque = nodes[j] + x * (nodes[j + 1] - nodes[j])
    amplitude, waves, phase = ripple
    added = amplitude * np.sin(waves * angle + phase) if amplitude != 0.0 else 0.0
    for s in range(stiffness.shape[0]):
        largest = limit[s] + coefficient[s] * abs(carried_torque)
        added += min(max(stiffness[s] * (angle - anchor[s]), -largest), largest)
    return angle, carried_torque, added


@part
def _beyond(position, sense, angles, ripple):
    """Where the first balance is looked for next: the next node, or nearer where a ripple is shorter."""
    node = np.floor(position) + 1.0 if sense > 0.0 else np.ceil(position) - 1.0
    j = min(max(int(np.floor(0.5 * (position + node))), 0), angles.shape[0] - 2)
    width = abs(angles[j + 1] - angles[j])
    if ripple[0] == 0.0 or width == 0.0:
        return node
    stride = 2.0 * np.pi / (abs(ripple[1]) * RIPPLE_SCAN * width)
    return position + sense * stride if stride < abs(node - position) else node


@entry
def _balanced(torques, curve, slides, ripple, angle_out, carried_out):
    """Angle and torque of the backbone along a history; see ``condensed_path``."""
    nodes, angles = curve
    stiffness, limit, coefficient = slides
    anchor = np.zeros(stiffness.shape[0])
    position = 0.5 * (nodes.shape[0] - 1)
    anchor[:], _, _ = _resistance(position, curve, slides, (0.0, 1.0, 0.0), anchor)
    small = ROOT_SHARE * (nodes[-1] - nodes[0])
    for t in range(torques.shape[0]):
        angle, carried_torque, added = _resistance(position, curve, slides, ripple, anchor)
        excess = carried_torque + added - torques[t]
        low, high, low_excess, high_excess, evaluations = position, position, excess, excess, 0
        # on to the first balance in the sense of the excess
        while high_excess < 0.0 and evaluations < MOST_LOOKS and high < FAR * nodes.shape[0]:
            low, low_excess, evaluations = high, high_excess, evaluations + 1
            high = _beyond(high, 1.0, angles, ripple)
            angle, carried_torque, added = _resistance(high, curve, slides, ripple, anchor)
            high_excess = carried_torque + added - torques[t]
        while low_excess > 0.0 and evaluations < MOST_LOOKS and low > -FAR * nodes.shape[0]:
            high, high_excess, evaluations = low, low_excess, evaluations + 1
            low = _beyond(low, -1.0, angles, ripple)
            angle, carried_torque, added = _resistance(low, curve, slides, ripple, anchor)
            low_excess = carried_torque + added - torques[t]
        for _ in range(ROOT_STEPS):
            if high_excess <= low_excess or high - low <= 1e-14:
                break
            position = low - low_excess * (high - low) / (high_excess - low_excess)
            if not low < position < high:
                position = 0.5 * (low + high)
            angle, carried_torque, added = _resistance(position, curve, slides, ripple, anchor)
            value = carried_torque + added - torques[t]
            if abs(value) <= small:
                break
            if value < 0.0:
                low, low_excess, high_excess = position, value, 0.5 * high_excess
            else:
                high, high_excess, low_excess = position, value, 0.5 * low_excess
        for s in range(stiffness.shape[0]):
            reach = (limit[s] + coefficient[s] * abs(carried_torque)) / stiffness[s]
            anchor[s] = min(max(anchor[s], angle - reach), angle + reach)
        angle_out[t], carried_out[t] = angle, carried_torque


def condensed_path(torques: Real, nodes: Real, angles: Real, sliders: Sliders, ripple: Ripple) -> tuple[Real, Real]:
    """Angle [rad] of the output and torque [N mm] in the reducer along a history, every slider on the output.

    Parameters
    ----------
    torques : (n_steps,) [N mm], in time order; the first is reached from rest in the middle of the play.
    nodes, angles : (n_nodes,) frictionless backbone, torque ascending; continued along its end segments.
    ripple : of a motor; where it is multivalued, the first balance on the way holds.

    Raises
    ------
    ValueError
        If a slider is pressed by a contact: its slip is no function of the torque in the reducer (after a reversal the
        disk turns about where its pins stick), so only ``solve_path`` follows it.
    """
    if sliders.at_contacts:
        raise ValueError("a slider at a contact cannot be condensed to the output")
    sliders = sliders.acting
    if not len(sliders) and ripple.amplitude == 0.0:
        return _on_backbone(torques, nodes, angles), torques
    rising = np.maximum.accumulate(angles)
    angle, carried_torque = np.empty(len(torques)), np.empty(len(torques))
    _balanced(
        np.asarray(torques, float),
        (nodes, rising),
        (sliders.stiffness, sliders.limit, sliders.coefficient),
        (ripple.amplitude, ripple.waves, ripple.phase),
        angle,
        carried_torque,
    )
    return angle, carried_torque


def _on_backbone(torques: Real, nodes: Real, angles: Real) -> Real:
    """Angle at each torque by linear interpolation, the end segments continued."""
    j = np.clip(np.searchsorted(nodes, torques) - 1, 0, len(nodes) - 2)
    return angles[j] + (torques - nodes[j]) * (angles[j + 1] - angles[j]) / (nodes[j + 1] - nodes[j])
