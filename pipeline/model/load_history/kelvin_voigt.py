"""Delayed rotation of a creeping reducer along its load history."""

import numpy as np

from pipeline.model.compiled import entry, part
from pipeline.model.geometry.cycloid_profile import Real


@part
def _on(now, passed, before, after, constant, compliance):
    """Delayed rotation after a time in which the torque went linearly from ``before`` to ``after``."""
    share = max(passed, 0.0) / constant
    left = np.exp(-share)
    mean = -np.expm1(-share) / share if share > 0.0 else 1.0
    return now * left + compliance * (after * (1.0 - mean) + before * (mean - left))


@entry
def _crept(torque, time, leg, turns, begun, constant, compliance, crept):
    """See ``crept``."""
    now, here, torque_here, on = 0.0, begun, turns[leg[0]], leg[0]
    for k in range(torque.shape[0]):
        way, last = 0.0, torque_here
        for turn in range(on + 1, leg[k] + 1):
            way += abs(turns[turn] - last)
            last = turns[turn]
        way += abs(torque[k] - last)
        gone, start, began, last = 0.0, here, torque_here, torque_here
        for turn in range(on + 1, leg[k] + 1):
            gone += abs(turns[turn] - last)
            last = turns[turn]
            when = start + gone / way * (time[k] - start) if way > 0.0 else time[k]
            now = _on(now, when - here, began, last, constant, compliance)
            here, began = when, last
        now = _on(now, time[k] - here, began, torque[k], constant, compliance)
        here, torque_here, on = time[k], torque[k], leg[k]
        crept[k] = now


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
    out = np.empty(len(torque))
    _crept(torque, time, leg, turns, _begun(torque, time, leg, turns), time_constant, compliance, out)
    return out


def _begun(torque: Real, time: Real, leg: np.ndarray, turns: Real) -> float:
    """Time at which the first leg left its start, its torque as fast as between its first two readings [s]."""
    if len(torque) < 2 or leg[1] != leg[0] or torque[1] == torque[0]:
        return float(time[0])  # a load that was put on at once
    rate = (time[1] - time[0]) / (torque[1] - torque[0])
    return float(time[0] - max((torque[0] - turns[leg[0]]) * rate, 0.0))
