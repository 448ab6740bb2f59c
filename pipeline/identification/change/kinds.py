"""Numbers of a loop that are compared between states of a drive.

Each is read off the measured loop without a model of the drive: no fit can end at a bound. Positive numbers are
compared on a log scale, where scatter that grows with the size is even.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.constant_kinds import Fineness
from pipeline.identification.change.loops import Loop
from pipeline.identification.measurement.enough import BENT, LOADED_SHARE

PLAY_LOADS = 0.35, 0.7
"""Shares of the largest torque between which the centre line is extrapolated to no torque: above, after the turn, the
falling branch sticks."""
LARGEST_ZERO = 0.3
"""Largest zero of the torque that is looked for, as a share of the largest torque; beyond: not measurable."""
TRIED_ZEROS: Fineness = 121
"""Zeros of the torque that are tried."""


@dataclass(frozen=True)
class Kind:
    """One number of a loop by which states may differ.

    Attributes
    ----------
    name, title, unit : of the number.
    positive : whether it is positive, and compared on a log scale.
    grows, falls : words for a change of either sign.
    value : of a loop; NaN where these loops do not show it.
    measurement : the measurement that determines it directly.
    """

    name: str
    title: str
    unit: str
    positive: bool
    grows: str
    falls: str
    value: Callable[[Loop], float]
    measurement: str


def zero_torque_width(loop: Loop) -> float:
    """Width of the loop at no torque [arcmin]."""
    return float(np.interp(0.0, loop.torque, loop.width))


def friction_torque(loop: Loop) -> float:
    """Loss of the loop over twice its travel: the mean friction torque [N m].

    The loss of a loop with Coulomb friction is 2 Tc times its travel, whatever the play and the spring are.
    """
    travel = float(loop.middle[-1] - loop.middle[0])
    return float(np.trapezoid(loop.width, loop.torque)) / (2 * travel) if travel > 0 else np.nan


def compliance(loop: Loop) -> float:
    """Slope of the loading branches over the upper half of the torque [arcmin/(N m)], mean of both senses.

    NaN where the play is crossed in it: there the slope is none of the spring.
    """
    means = []
    for sense, angle in ((1, loop.rising), (-1, loop.falling)):
        load = sense * loop.torque / loop.torque[-1]
        lower, upper = (
            (load >= low) & (load <= low + LOADED_SHARE / 2) for low in (LOADED_SHARE, 1 - LOADED_SHARE / 2)
        )
        slopes = [_slope(loop.torque[part], angle[part]) for part in (lower, upper, lower | upper)]
        if min(slopes) <= 0 or max(slopes[:2]) > BENT * min(slopes[:2]):
            return np.nan
        means.append(slopes[2])
    return float(np.mean(means))


def play(loop: Loop) -> float:
    """Angle at no torque between the centre lines of both senses, extrapolated from the loaded parts [arcmin].

    Friction alike in both senses of motion drops out. NaN where the loops do not load the spring.
    """
    if not np.isfinite(compliance(loop)):
        return np.nan
    intercepts = []
    for sense in (1, -1):
        load = sense * loop.torque / loop.torque[-1]
        part = (load >= PLAY_LOADS[0]) & (load <= PLAY_LOADS[1])
        intercepts.append(np.polyfit(loop.torque[part], loop.middle[part], 1)[1])
    return float(intercepts[0] - intercepts[1])


def torque_zero(loop: Loop) -> float:
    """Torque [N m] about which the loop is symmetric; NaN where that lies at the end of the range of search."""
    top = float(loop.torque[-1])
    zeros_tried = np.linspace(-LARGEST_ZERO, LARGEST_ZERO, TRIED_ZEROS) * top
    steps = np.linspace(0.0, (1 - LARGEST_ZERO) * top, len(loop.torque) // 2)
    misfit = _asymmetry(loop, zeros_tried[:, None], steps)
    best_zero = int(np.argmin(misfit))
    if best_zero in (0, TRIED_ZEROS - 1):
        return np.nan
    misfit_before, lowest, misfit_after = misfit[best_zero - 1 : best_zero + 2]
    curvature = misfit_before - 2 * lowest + misfit_after
    shift = 0.5 * (misfit_before - misfit_after) / curvature if curvature > 0 else 0.0
    return float(zeros_tried[best_zero] + shift * (zeros_tried[1] - zeros_tried[0]))


def _asymmetry(loop: Loop, zeros: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Mean squares (n,) [arcmin^2] by which a loop differs from itself turned about torques (n, 1), without offset."""
    above, below = zeros + steps, zeros - steps
    rising = np.interp(above, loop.torque, loop.rising) + np.interp(below, loop.torque, loop.falling)
    falling = np.interp(above, loop.torque, loop.falling) + np.interp(below, loop.torque, loop.rising)
    return np.asarray(np.var(np.concatenate([rising, falling], axis=1), axis=1))


def _slope(torque: np.ndarray, angle: np.ndarray) -> float:
    return float(np.polyfit(torque, angle, 1)[0])


KINDS = (
    Kind(
        name="width",
        title="width at zero torque",
        unit="arcmin",
        positive=True,
        grows="the width at zero torque grows",
        falls="the width at zero torque falls",
        value=zero_torque_width,
        measurement="the angle of the output between two small torques of opposite sense",
    ),
    Kind(
        name="play",
        title="play",
        unit="arcmin",
        positive=True,
        grows="play opens",
        falls="play closes",
        value=play,
        measurement="a small torque by hand in both senses",
    ),
    Kind(
        name="friction",
        title="friction torque",
        unit="N m",
        positive=True,
        grows="friction grows",
        falls="friction falls",
        value=friction_torque,
        measurement="the torque that turns the drive slowly without load",
    ),
    Kind(
        name="compliance",
        title="compliance",
        unit="arcmin/(N m)",
        positive=True,
        grows="compliance grows",
        falls="compliance falls",
        value=compliance,
        measurement="the slope of the same branch between half and all of the load",
    ),
    Kind(
        name="torque_zero",
        title="zero of the torque, or preload of one sense",
        unit="N m",
        positive=False,
        grows="the zero of the torque rises, or a preload",
        falls="the zero of the torque falls, or a preload",
        value=torque_zero,
        measurement="the reading of the torque with the drive taken off",
    ),
)
