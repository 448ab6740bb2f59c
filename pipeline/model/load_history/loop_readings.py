"""What the metrics need of a loop, read from its curve."""

import numpy as np

from pipeline.arrays import Real
from pipeline.model.load_history.load_cycle import ARCMIN, BRANCHES
from pipeline.model.load_history.response import CycleResponse
from pipeline.model.metrics import Definitions, LoopReadings
from pipeline.model.units import NMM_PER_NM


def _level(torque: Real, target: float, steps: np.ndarray) -> int:
    """Step among ``steps`` at the torque ``target``.

    Raises
    ------
    ValueError
        If no step has that torque.
    """
    nearest_step = int(np.argmin(np.abs(torque[steps] - target)))
    if abs(torque[steps][nearest_step] - target) > 1e-9 * np.max(np.abs(torque)):
        raise ValueError(f"the curve has no point at {target:g}, the nearest is {torque[steps][nearest_step]:g}")
    return int(steps[nearest_step])


def curve_readings(
    branch: np.ndarray, torque: Real, angle: Real, limits: Real, peak_pressure: Real, definitions: Definitions
) -> LoopReadings:
    """Readings of cycles 0 -> +T -> -T -> +T.

    Parameters
    ----------
    branch : (n_steps,) names of ``BRANCHES``
    torque : (n_steps,) [N m]
    angle : (n, n_steps) [arcmin]
    limits : (n, 2) angle without friction in the limits T -> 0- and T -> 0+ [arcmin].
    peak_pressure : (n,) [MPa]
    definitions : torques at which the metrics are read.

    Notes
    -----
    The centre line of the loop is the mean of its two branches at equal torque.

    Raises
    ------
    ValueError
        If the curve lacks a point that a definition asks for.
    """
    steps = {name: np.flatnonzero(branch == name) for name in BRANCHES}

    def reading(name: str, level: float) -> Real:
        return angle[:, _level(torque, level, steps[name])]

    slight = definitions.lost_motion
    return LoopReadings(
        limit_minus=limits[:, 0],
        limit_plus=limits[:, 1],
        zero_falling=reading("unloading+", 0.0),
        zero_rising=reading("unloading-", 0.0),
        lost_motion_minus=0.5 * (reading("loading-", -slight) + reading("unloading-", -slight)),
        lost_motion_plus=0.5 * (reading("unloading+", slight) + reading("reloading+", slight)),
        low_minus=reading("loading-", -definitions.rigidity_low),
        high_minus=reading("loading-", -definitions.rigidity_high),
        low_plus=reading("reloading+", definitions.rigidity_low),
        high_plus=reading("reloading+", definitions.rigidity_high),
        peak_pressure=peak_pressure,
        load_share=np.ones(len(angle)),
    )


def held_states(response: CycleResponse, definitions: Definitions) -> np.ndarray:
    """Equilibria (2,) of a drive at plus and minus the higher torque of the rigidity, each held on its way up.

    Their angles are ``high_plus`` and ``high_minus`` of the readings; raises as ``curve_readings``.
    """
    branch, torque = np.asarray(BRANCHES)[response.branch], response.torque / NMM_PER_NM
    levels = (("reloading+", definitions.rigidity_high), ("loading-", -definitions.rigidity_high))
    return response.state[[_level(torque, level, np.flatnonzero(branch == name)) for name, level in levels]]


def loop_readings(response: CycleResponse, peak_pressure: Real, definitions: Definitions) -> LoopReadings:
    """Readings of a drive's loops; ``peak_pressure`` (n,) [MPa]; raises as ``curve_readings``."""
    branch, torque = np.asarray(BRANCHES)[response.branch], response.torque / NMM_PER_NM
    angle, play = ARCMIN * response.angle, ARCMIN * response.play
    return curve_readings(branch, torque, angle, play, peak_pressure, definitions)
