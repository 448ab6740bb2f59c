"""Delayed rotation of a creeping reducer along its load history."""

import numpy as np

from pipeline.model.compiled import entry, part
from pipeline.model.geometry.cycloid_profile import Real


@part
def _on(twist, interval, torque_before, torque_after, constant, compliance):
    """Delayed rotation after a time in which the torque went linearly from ``torque_before`` to ``torque_after``."""
    share = max(interval, 0.0) / constant
    remaining = np.exp(-share)
    mean = -np.expm1(-share) / share if share > 0.0 else 1.0
    return twist * remaining + compliance * (torque_after * (1.0 - mean) + torque_before * (mean - remaining))


@entry
def _crept(torque, time, leg, turns, start_time, constant, compliance, crept):
    """See ``crept``."""
    twist, last_time, torque_here, last_leg = 0.0, start_time, turns[leg[0]], leg[0]
    for k in range(torque.shape[0]):
        travel, torque_before = 0.0, torque_here
        for turn in range(last_leg + 1, leg[k] + 1):
            travel += abs(turns[turn] - torque_before)
            torque_before = turns[turn]
        travel += abs(torque[k] - torque_before)
        elapsed, start, began, torque_before = 0.0, last_time, torque_here, torque_here
        for turn in range(last_leg + 1, leg[k] + 1):
            elapsed += abs(turns[turn] - torque_before)
            torque_before = turns[turn]
            instant = start + elapsed / travel * (time[k] - start) if travel > 0.0 else time[k]
            twist = _on(twist, instant - last_time, began, torque_before, constant, compliance)
            last_time, began = instant, torque_before
        twist = _on(twist, time[k] - last_time, began, torque[k], constant, compliance)
        last_time, torque_here, last_leg = time[k], torque[k], leg[k]
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
