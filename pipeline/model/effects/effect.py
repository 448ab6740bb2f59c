"""What an effect is, and the library of all."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from pipeline.arrays import Real
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.load_cycle import ARCMIN
from pipeline.registry import EFFECTS

CRANKS, CYCLES, TIME, TEMPERATURE, STILL, RATE = "cranks", "cycles", "time", "temperature", "still", "rate"
LOOPS, SENSES, TORQUES, MOVES, FLANGE = "loops", "senses", "torques", "moves", "flange"
NEEDS = {
    CRANKS: "at least three crank angles",
    CYCLES: "at least two cycles",
    TIME: "time stamps",
    TEMPERATURE: "a temperature that varies",
    STILL: "a crank that stays within half a pitch of the pins",
    RATE: "a rate of the torque that changes, or a dwell",
    LOOPS: "a torque that turns back while the crank stands still",
    SENSES: "both senses of motion",
    TORQUES: "several torques",
    MOVES: "a crank of known angle that turns within the loops, the output locked",
    FLANGE: "the angle of the reducer's flange beside that of the lever, which no unit file can state",
}
"""What data must offer for an effect to be testable, in words. Loops have turns, both senses and several torques."""

LARGEST_CLEARANCE = 1 / 3
"""Clearance that an effect may give, over the eccentricity."""
LARGEST_INTERFERENCE = 1 / 30
"""Interference that an effect may give, over the eccentricity."""


@dataclass(frozen=True)
class Parameter:
    """One number of an effect; its name ends in its unit, as ``compliance_arcmin_per_Nm`` does in "arcmin/(N m)".

    ``record`` says of a time constant what must last longer than it for a claim: ``TIME`` or ``CYCLES``.
    ``of_position`` says that it is a number of one position, fitted but not reported.

    Raises
    ------
    ValueError
        If the name does not end in the unit.
    """

    name: str
    unit: str
    meaning: str
    record: str = ""
    of_position: bool = False

    def __post_init__(self) -> None:
        if not self.name.endswith(self._ending):
            raise ValueError(f"{self.name}: the name of a number in {self.unit} must end in {self._ending}")

    @property
    def _ending(self) -> str:
        """Of a name with this unit."""
        if self.unit == "1":
            return ""
        words = self.unit.replace("N m", "Nm").replace("1/", "per ").replace("/", " per ")
        return "_" + words.replace("(", "").replace(")", "").replace(" ", "_")

    @property
    def quantity(self) -> str:
        """The name less its unit, in words."""
        return self.name.removesuffix(self._ending).replace("_", " ")


def clearances(drive: Drive, shrinks: bool = False) -> tuple[float, float]:
    """Bounds [um] of a dimension that gives clearance where it grows, or where it ``shrinks``."""
    unit = 1e3 * drive.profile.eccentricity
    pair = (-LARGEST_INTERFERENCE * unit, LARGEST_CLEARANCE * unit)
    return (-pair[1], -pair[0]) if shrinks else pair


@dataclass(frozen=True)
class Conditions:
    """Of the ``n`` states of a drive: load cycles travelled (n,), temperature less that of the drawing (n,) [K]."""

    cycle: Real
    temperature_rise: Real

    @classmethod
    def run_in(cls, n: int, temperature_rise: float = 0.0) -> "Conditions":
        """Fully run in, at a temperature over that of the drawing [K]."""
        return cls(np.full(n, np.inf), np.full(n, temperature_rise))


@dataclass(frozen=True)
class EffectDescription:
    """An effect in words.

    Attributes
    ----------
    name : as under ``[effects]`` of a design.
    title : for people.
    physics, source : what it is, and where the formula stands.
    parameters : one to three.
    changes : what it changes in the model.
    signature : how it shows in measured curves.
    confused_with : names of effects that curves alone hardly tell from it.
    told_apart_by : the measurement that tells it from them.
    """

    name: str
    title: str
    physics: str
    source: str
    parameters: tuple[Parameter, ...]
    changes: str
    signature: str
    confused_with: tuple[str, ...]
    told_apart_by: str


@dataclass(frozen=True)
class Effect(EffectDescription):
    """A physical effect.

    Attributes
    ----------
    bounds : of a drive: (low, high) of every parameter.
    apply : drive, values, conditions to the drive with the effect.
    needs : what the data must offer; a study's load cycle has no ``TIME``.
    limit_case : name of the simpler effect that it becomes at a limit of its parameters, or "".
    starts : where its fit starts: from "secants" of its parameters, or from many "periods" of a ripple.
    """

    bounds: Callable[[Drive], tuple[tuple[float, float], ...]]
    apply: Callable[[Drive, Sequence[float], Conditions], Drive]
    needs: frozenset[str] = frozenset()
    limit_case: str = ""
    starts: str = "secants"


SOFTEST = 100.0
"""Twists in series with the output are looked for up to this multiple of what the pins alone give."""


def largest_twist(drive: Drive) -> float:
    """Largest compliance in series with the output that is looked for [arcmin/(N m)].

    In proportion to that of a quarter of the pins, each with its own contact and its part of the disk.
    """
    arm = np.abs(drive.reducer.pins.arm)
    force = np.full(len(drive.laws), drive.rated_torque / (0.25 * np.sum(arm)))
    yielding = (drive.laws.compliance(force) + np.diag(drive.compliance))[: len(arm)]
    return float(SOFTEST * 1e3 * ARCMIN / (0.25 * np.sum(arm**2 / yielding)))


@cache
def library() -> Mapping[str, Effect]:
    """All effects by name: those of the files here, and what installed packages register; sorted.

    Raises
    ------
    ValueError
        If a registered effect has the name of another one.
    """
    return dict(sorted(EFFECTS.declarations().items()))
