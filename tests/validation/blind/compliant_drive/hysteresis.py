"""What lies between the elastic drive and the bench: friction, twists with and without memory, row by row."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]


def carried(torque: Real, constant: float, share: float) -> Real:
    """Torque (n,) that the drive carries under a load (n,): a play whose width is ``constant`` and ``share`` of it.

    Friction opposes the rotation: while it rises the load exceeds the torque carried by both, while it falls it is
    less by both.
    """
    inside, now = np.empty(len(torque)), 0.0
    for k, load in enumerate(torque):
        low, high = load - constant, load + constant
        low = low / (1 + share) if low > 0 else low / (1 - share)
        high = high / (1 - share) if high > 0 else high / (1 + share)
        now = min(max(now, low), high)
        inside[k] = now
    return inside


def rayleigh_twist(torque: Real, coefficient: float) -> Real:
    """Twist (n,) of Rayleigh's hysteresis after Madelung's rules: each branch a parabola from where the load turned.

    A branch that passes an earlier turn goes on along the branch that had been left there.
    """
    twist, past, now = np.empty(len(torque)), [(0.0, 0.0)], (0.0, 0.0)
    for k, load in enumerate(torque):
        if k and (load - now[0]) * (now[0] - past[-1][0]) < 0:
            past.append(now)
        while len(past) >= 3 and (load - past[-2][0]) * (past[-2][0] - past[-1][0]) > 0:
            past = past[:-2]
        if len(past) == 2 and abs(load) > abs(past[1][0]):
            past = [(0.0, 0.0)]
        turn, offset = past[-1]
        change = load - turn
        grown = np.sign(change) * change**2
        twist[k] = coefficient * grown if len(past) == 1 else offset + 0.5 * coefficient * grown
        now = (load, twist[k])
    return twist


def delayed(torque: Real, time: Real, constant: float, start: float = 0.0) -> Real:
    """First-order lag (n,) of a torque behind time (n,) [s], implicit in each of its rows."""
    lagged, now = np.empty(len(torque)), start
    for k, load in enumerate(torque):
        step = (time[k] - time[k - 1]) if k else 0.0
        now = (now + step / constant * load) / (1 + step / constant)
        lagged[k] = now
    return lagged


def followed(torque: Real, half_width: float) -> Real:
    """Play (n,) of a half width along a torque."""
    inside, now = np.empty(len(torque)), 0.0
    for k, load in enumerate(torque):
        now = min(max(now, load - half_width), load + half_width)
        inside[k] = now
    return inside
