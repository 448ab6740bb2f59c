"""Friction of elastic-slip elements; and of drives without a design what slides at once, and a memory of the torque."""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.arrays import Real, Whole
from pipeline.model.compiled import entry
from pipeline.model.contact.friction_elements import Sliders
from pipeline.model.elements.element import Element

STAGES = 5
"""Friction elements in series where their thresholds are spread."""
LARGEST_SHARE = 0.95
"""Friction of a stage over the torque that it leaves: at 1 nothing comes back."""


@dataclass(frozen=True)
class Friction(Element):
    """In parallel with the output or at the contacts.

    Attributes
    ----------
    sliders : elastic-slip elements; their resistance has its limits at T -> 0 in ``Sliders.limit``.
    lean : torque beyond the one carried, over it, that the turning end takes in either sense of motion: half of what
        friction in proportion to the load resists more with the load than against it.
    """

    sliders: Sliders
    lean: float = 0.0

    def at_drawing_modulus(self, factor: float) -> "Friction":
        """Friction that is to the modulus of the drawing as this is to one that is ``factor`` times as large."""
        sliders = self.sliders
        scaled = replace(sliders, limit=sliders.limit / factor, stiffness=sliders.stiffness / factor)
        return replace(self, sliders=scaled)


@entry
def carried_torque(torque: Real, runs: Whole, constant: float, share: float) -> Real:
    """Torque c (n,) behind friction along torques T (n,), from no torque at each run's start.

    A play operator: c stays while |T - c| is at most ``constant`` + ``share`` |c|, with ``share`` below 1.
    """
    carried, load = np.empty(len(torque)), 0.0
    for k in range(len(torque)):
        if k == 0 or runs[k] != runs[k - 1]:
            load = 0.0
        low, high = torque[k] - constant, torque[k] + constant
        low /= 1 + share if low > 0.0 else 1 - share
        high /= 1 - share if high > 0.0 else 1 + share
        load = min(max(load, low), high)
        carried[k] = load
    return carried


@entry
def largest_on_its_side(torque: Real, runs: Whole) -> Real:
    """Largest size (n,) that torques (n,) of the same sense had so far, from each run's start."""
    largest_torque = np.empty(len(torque))
    rising, falling = 0.0, 0.0
    for k in range(len(torque)):
        if k == 0 or runs[k] != runs[k - 1]:
            rising, falling = 0.0, 0.0
        rising, falling = max(rising, torque[k]), max(falling, -torque[k])
        largest_torque[k] = rising if torque[k] > 0.0 else falling
    return largest_torque


@dataclass(frozen=True)
class SlidingFriction(Element):
    """In parallel with the output: it takes part of the torque, and the elements in series carry the rest.

    Attributes
    ----------
    constant : torque Tc that it takes at most without load.
    share : mu, what it takes beyond, over the torque c that it leaves; below 1.
    spread : of the thresholds of ``STAGES`` units in series over their mean; 0 where all slides at once.

    Source
    ------
    Play operator of half-width Tc + mu |c|: Visintin, Differential Models of Hysteresis (1994). In stages: Masing
    (1926); Iwan, J. Appl. Mech. 33 (1966) 893.
    """

    constant: float
    share: float
    spread: float = 0.0

    def carried(self, torque: Real, runs: Whole) -> Real:
        """Torque (n_stages, n) of the elements in series with each stage, along torques (n,) of runs (n,) from rest."""
        stages = np.maximum(1 + self.spread * np.linspace(-1, 1, STAGES), 0.0) if self.spread else np.ones(1)
        parts = [(s * self.constant, min(s * self.share, LARGEST_SHARE)) for s in stages.tolist()]
        return np.array([carried_torque(torque, runs, *part) for part in parts])


@dataclass(frozen=True)
class FirstLoading(Element):
    """On the elements in series: how they twist more in one sense, and after a larger torque in that sense.

    Attributes
    ----------
    asymmetry : twist in the positive sense over the mean of both senses, less 1.
    growth : of the twist, by the largest torque so far on that side [1 / torque].

    Source
    ------
    Softening by the largest load: Mullins, Rubber Chem. Technol. 42 (1969) 339.
    """

    asymmetry: float
    growth: float

    def factor(self, torque: Real, runs: Whole) -> Real:
        """Factor (n,) of the twist along torques (n,) of runs (n,) from rest."""
        factor = 1 + self.asymmetry * np.sign(torque)
        return factor * (1 + self.growth * largest_on_its_side(torque, runs)) if self.growth else factor
