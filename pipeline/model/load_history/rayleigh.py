"""Hysteresis that does not depend on the rate: the law of Rayleigh, with its memory of turning points."""

import numpy as np

from pipeline.model.compiled import entry
from pipeline.model.geometry.cycloid_profile import Real


@entry
def _followed(torque, turn_torque, turn_twist, twist):
    """See ``rayleigh_twist``; the arrays of turning points (n + 1,) are filled on the way."""
    turn_torque[0], turn_twist[0], count, torque_now, twist_now = 0.0, 0.0, 1, 0.0, 0.0
    sense = 0.0
    for k in range(torque.shape[0]):
        goal = torque[k]
        onward = 1.0 if goal >= torque_now else -1.0
        if goal != torque_now:
            if sense != 0.0 and onward != sense:
                turn_torque[count], turn_twist[count] = torque_now, twist_now
                count += 1
            sense = onward
        # a loop closes where the torque passes the turn before the last: both are forgotten
        while count > 2 and onward * (goal - turn_torque[count - 2]) >= 0.0:
            count -= 2
        if count == 2 and onward * goal >= abs(turn_torque[1]):
            count = 1
        if count == 1:
            twist_now = goal * abs(goal)
        else:
            distance = goal - turn_torque[count - 1]
            twist_now = turn_twist[count - 1] + 0.5 * distance * abs(distance)
        torque_now = goal
        twist[k] = twist_now


def rayleigh_twist(torque: Real, coefficient: float) -> Real:
    """Twist [rad] (n,) along torques (n,) [N mm] in time order, from rest without torque.

    The first loading goes along eta T |T|, every later stretch along eta/2 (T - Tr) |T - Tr| from its turn Tr. A loop
    that closes is forgotten, and beyond the largest torque the first curve goes on.

    Parameters
    ----------
    coefficient : eta [rad/(N mm)^2]; a loop between +-T has the area 4/3 eta T^3.

    Source
    ------
    Lord Rayleigh, Phil. Mag. 23 (1887) 225; with the memory of turns as Preisach's model of constant density:
    Review of Play and Preisach Models for Hysteresis in Magnetic Materials, Materials 16 (2023) 2422.
    """
    torques = np.ascontiguousarray(torque, float)
    twist = np.empty(len(torques))
    _followed(torques, np.empty(len(torques) + 2), np.empty(len(torques) + 2), twist)
    return coefficient * twist
