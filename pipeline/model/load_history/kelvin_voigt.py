"""Delayed rotation of a creeping reducer along its load history."""

import numpy as np

from pipeline.model.compiled import entry, part
from pipeline.model.geometry.cycloid_profile import Real


@part
def _on(twist, passed, before, after, constant, compliance):
    """Delayed rotation after a time in which the torque went linearly from ``before`` to ``after``."""
    share = max(passed, 0.0) / constant
    remaining = np.exp(-share)
    mean = -np.expm1(-share) / share if share > 0.0 else 1.0
    return twist * remaining + compliance * (after * (1.0 - mean) + before * (mean - remaining))


@entry
def _crept(torque, time, leg, turns, begun, constant, compliance, crept):
    """See ``crept``."""
    twist, since, torque_here, on = 0.0, begun, turns[leg[0]], leg[0]
    for k in range(torque.shape[0]):
        travel, torque_before = 0.0, torque_here
        for turn in range(on + 1, leg[k] + 1):
            travel += abs(turns[turn] - torque_before)
            torque_before = turns[turn]
        travel += abs(torque[k] - torque_before)
        gone, start, began, torque_before = 0.0, since, torque_here, torque_here
        for turn in range(on + 1, leg[k] + 1):
            gone += abs(turns[turn] - torque_before)
            torque_before = turns[turn]
            instant = start + gone / travel * (time[k] - start) if travel > 0.0 else time[k]
            twist = _on(twist, instant - since, began, torque_before, constant, compliance)
            since, began = instant, torque_before
        twist = _on(twist, time[k] - since, began, torque[k], constant, compliance)
        since, torque_here, on = time[k], torque[k], leg[k]
        crept[k] = twist


def crept(torque: Real, time: Real, leg: np.ndarray, turns: Real, compliance: float, time_constant: float) -> Real:
    """Delayed rotation [rad] of a Kelvin-Voigt element at each reading: exact for a torque linear in time.

    Parameters
    ----------
    torque, time : (n,) at the readings [N mm], [s]; in time order.
    leg : (n,) monotone stretch of the history on which each reading lies; it goes from turns[leg] to turns[leg + 1].
    turns : (n_turns,) torques between which it turns [N mm], passed at one speed of the torque. The element starts at
        rest at turns[leg[0]].
    compliance, time_constant : of the element [rad/(N mm)], [s].

    Source
    ------
    Kelvin-Voigt element under piecewise linear load; Findley, Lai, Onaran, Creep and Relaxation of Nonlinear
    Viscoelastic Materials (1976), ch. 5.
    """
    twist = np.empty(len(torque))
    _crept(torque, time, leg, turns, _begun(torque, time, leg, turns), time_constant, compliance, twist)
    return twist


def _begun(torque: Real, time: Real, leg: np.ndarray, turns: Real) -> float:
    """Time at which the first leg left its start, its torque as fast as between its first two readings [s]."""
    if len(torque) < 2 or leg[1] != leg[0] or torque[1] == torque[0]:
        return float(time[0])  # a load that was put on at once
    rate = (time[1] - time[0]) / (torque[1] - torque[0])
    return float(time[0] - max((torque[0] - turns[leg[0]]) * rate, 0.0))
