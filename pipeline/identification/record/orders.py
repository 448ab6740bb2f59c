"""Orders of a drive in waves per turn of its output: of the output, the crank and the input."""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from pipeline.config.mechanisms.carrier import Carrier
from pipeline.identification.measurement.unit_file import UnitFile

HARMONICS = (1, 2)
"""Waves per turn of each shaft that effects are looked for at."""
TIMES = {1: "once", 2: "twice"}


@dataclass(frozen=True)
class Orders:
    """What turns how often while the output turns once.

    Attributes
    ----------
    ratio : turns of the input.
    shafts : turns of each shaft by its name.
    period : turns of the output after which all shafts stand as before.
    """

    ratio: float
    shafts: Mapping[str, float]
    period: int

    @property
    def waves(self) -> dict[str, tuple[str, float]]:
        """Title and order of each wave that effects are looked for at, by a name such as ``crank_twice``."""
        return {
            f"{shaft} {TIMES[times]}".replace(" ", "_"): (f"{TIMES[times]} per turn of the {shaft}", times * turns)
            for shaft, turns in self.shafts.items()
            for times in HARMONICS
        }


def orders_of(unit: UnitFile) -> Orders:
    """The orders of a unit: of a carrier by its teeth, of a drive without a design by what unit.toml states.

    A crank of a carrier turns against it N times per turn of the output, which is how it meets its bearings there.
    """
    generic = unit.settings.generic
    if generic is not None:
        ratio = generic.ratio
        return Orders(ratio, _shafts(ratio, generic.crank_turns), _period(ratio))
    design = unit.study.design
    assert isinstance(design.output, Carrier)  # which has planets before the crank
    ratio = design.output.ratio(design.cycloid)
    return Orders(ratio, _shafts(ratio, float(design.cycloid.pins)), design.output.output_turns(design.cycloid))


def _shafts(ratio: float, crank_turns: float | None) -> dict[str, float]:
    """Turns of each shaft per turn of the output; with gears before the crank also seen from the other side.

    Bearings in the output meet a crank ``crank_turns`` times, the housing's pins once less; the planets meet the sun
    ``ratio`` - 1 times, the housing the input ``ratio`` times.
    """
    if crank_turns is None:
        return {"output": 1.0, "input": ratio}
    seen_from_output = {"crank": crank_turns, "crank against the housing": crank_turns - 1}
    return {"output": 1.0, **seen_from_output, "input": ratio, "input against the output": ratio - 1}


def _period(ratio: float) -> int:
    """Turns of the output after which the input stands as before; 1 of a ratio that is no simple fraction."""
    fraction = Fraction(ratio).limit_denominator(60)
    return fraction.denominator if abs(float(fraction) - ratio) < 1e-9 * ratio else 1
