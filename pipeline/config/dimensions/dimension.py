"""What a toleranced dimension declares, the elements that have one each, and the library of all."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Literal

from pipeline.arrays import Real
from pipeline.config.designs.design import Design
from pipeline.registry import DIMENSIONS

REDUCER, DISKS = "reducer", "disks"
"""Tables of what a reducer and each of its disks have once; the first has the numbers of disk 0, too."""


@dataclass(frozen=True)
class Elements:
    """Parts of a reducer that have one deviation each.

    Attributes
    ----------
    name : of one.
    count : number of them in a design, of a disk's elements on each disk.
    radius_mm : of the circle along which they are machined one after the other, None where they are made apart.
    listed_with : elements whose table has their columns, one row for either; "" if the table is their own.
    """

    name: str
    count: Callable[[Design], int]
    radius_mm: Callable[[Design], float] | None
    listed_with: str = ""

    @property
    def table(self) -> str:
        """Table of the stage ``sample`` that has a row for each."""
        return f"{self.listed_with or self.name}s"


PINS = Elements("pin", lambda design: design.cycloid.pins, lambda design: design.cycloid.pin_circle_radius_mm)
LOBES = Elements(
    "lobe",
    lambda design: design.cycloid.lobes,
    lambda design: design.cycloid.pin_circle_radius_mm - design.cycloid.pin_radius_mm,
)
"""Along the disk at half of the lobes' height."""
ROLLERS = Elements("roller", lambda design: design.output.contacts, None)
OUTPUT_PINS = Elements("output_pin", lambda design: design.output.contacts, None, listed_with="roller")
"""Pins of the flange in holes of the disks, which are all that such an output's contacts have."""
CRANKSHAFTS = Elements("crank", lambda design: design.output.holes_in_disk if design.output.carries_disks else 0, None)
"""Cranks of a carrier with their planets, counted clockwise."""
HOLES = Elements("hole", lambda design: design.output.holes_in_disk, None)
"""Holes of a disk, each about one output pin or the eccentric of one crank."""


@dataclass(frozen=True)
class Need:
    """What a reducer must have for a dimension to act on anything.

    Attributes
    ----------
    condition : whether a design has it.
    wording : in words, after "needs".
    """

    condition: Callable[[Design], bool]
    wording: str


PINS_IN_HOLES = Need(lambda design: design.output.pins_in_holes > 0, 'pins in holes, mechanism = "pin_in_hole"')
HOLES_IN_DISK = Need(
    lambda design: design.output.holes_in_disk > 0, 'holes in the disks, mechanism = "pin_in_hole" or "carrier"'
)
CRANKS = Need(lambda design: design.output.carries_disks, 'cranks in the disks, mechanism = "carrier"')
LOOSE_SUPPORTS = Need(
    lambda design: design.output.has_loose_supports, "supports that are not preloaded, crankshaft.support_clearance_um"
)
BUSHES = Need(lambda design: design.output.has_bushes, "bushes on the output pins, [output.bush]")


@dataclass(frozen=True, kw_only=True)
class Dimension:
    """A dimension of which a study gives a tolerance.

    Attributes
    ----------
    name : as the study file has it; of elements it begins with theirs.
    title : as the report tells it.
    sign : which deviation is positive, or what it does.
    meaning : of its column in the tables.
    rank : place in study files and reports, ascending.
    draw_columns : its place in the design of experiment, and that of its direction; one after all others leaves their
        order.
    elements : what has one each; None for a dimension of the whole reducer, or of a disk.
    of_disk : whether every disk has deviations of its own.
    fewest_disks : disks of a reducer below which it acts on nothing.
    one_sided : whether the total cannot be negative: a clearance, an amplitude.
    direction : meaning of its random direction, of each element its own, which makes the deviation an amplitude; empty
        without one.
    zone : whether amplitude and direction are a point in a circular zone, whose diameter the drawing states.
    need : what a reducer must have for it, None where all have it.
    size_um : nominal size that no deviation may use up, where it has one.
    measure : whether it is a diameter or a radius; empty if neither. A drawing may state the one for the other.
    drawing_sign : -1 where a positive deviation is material off, so that a drawing has the other sign; else 1.
    gap_sign : 1 where a positive deviation opens gaps, -1 where it closes them, 0 where it may do either.
    acts_on : dimension of elements through which it acts, in place of a gap of its own.
    counted_where_varied : whether it has places in the design of experiment only in studies that vary it, so that all
        others draw what they drew before it was known.
    displaces : whether it displaces an element, and the output mechanism states how that opens its contacts.
    shift : deviations (n,), directions (n,) [rad] and design to what they add to ``acts_on`` (n, n_elements).
    """

    name: str
    title: str
    sign: str
    meaning: str
    rank: int
    draw_columns: tuple[int, ...]
    elements: Elements | None = None
    of_disk: bool = False
    fewest_disks: int = 1
    one_sided: bool = False
    direction: str = ""
    zone: bool = False
    need: Need | None = None
    size_um: Callable[[Design], float] | None = None
    measure: Literal["", "diameter", "radius"] = ""
    drawing_sign: Literal[1, -1] = 1
    gap_sign: Literal[1, 0, -1] = 0
    acts_on: str = ""
    counted_where_varied: bool = False
    displaces: bool = False
    shift: Callable[[Real, Real, Design], Real] | None = None

    @property
    def field(self) -> str:
        """Name among the errors of a sample."""
        return f"{self.name}_amplitude" if self.direction else self.name

    @property
    def phase(self) -> str:
        """Name of the direction among the errors of a sample."""
        return f"{self.name}_phase"

    def count(self, design: Design) -> int:
        """Number of deviations of a reducer, disk after disk; 0 of a reducer that cannot have them."""
        disks = design.disk.count if self.of_disk else 1
        per_disk = self.elements.count(design) if self.elements else 1
        is_met = design.disk.count >= self.fewest_disks and (self.need is None or self.need.condition(design))
        return disks * per_disk if is_met else 0

    def refusal(self, design: Design) -> str:
        """Why a reducer cannot have a deviation."""
        if self.need and not self.need.condition(design):
            return f"acts on nothing: it needs {self.need.wording}; delete it"
        return f"acts on nothing with [disk] count = {design.disk.count}: it counts against another disk; delete it"

    @property
    def table(self) -> str:
        """Table of the stage ``sample`` that has its column."""
        return self.elements.table if self.elements else REDUCER

    @property
    def column(self) -> str:
        """Column in ``table``."""
        return f"{self._in_table(self.field)}_um"

    @property
    def phase_column(self) -> str:
        """Column of the direction in ``table``."""
        return f"{self._in_table(self.phase)}_rad"

    def _in_table(self, field: str) -> str:
        return field.removeprefix(f"{self.table.removesuffix('s')}_") if self.elements else field


@cache
def dimension_library() -> Mapping[str, Dimension]:
    """All dimensions by name and rank: the files beside this one and what packages register."""
    dimensions = DIMENSIONS.declarations()
    return dict(sorted(dimensions.items(), key=lambda item: item[1].rank))
