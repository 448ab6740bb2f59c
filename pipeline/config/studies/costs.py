"""What a tolerance costs: of each dimension the cost of one element, or of the whole ring, against its zone."""

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, create_model

from pipeline.arrays import Real
from pipeline.config.designs.design import Design
from pipeline.config.dimensions import dimension_library
from pipeline.config.files.section import Mistake, NotNegative, Positive, Section
from pipeline.config.tolerance_notation import TOLERANCES_UM, UP_TO_MM, grade_width_um

EXAMPLE_COSTS = {str(grade): 10 ** ((6 - grade) / 5) for grade in TOLERANCES_UM}
"""Relative cost by grade, that of grade 6 being 1: an EXAMPLE, no measurement. From grade 6 on the zones of ISO
286-1:2010 step by the preferred numbers R5 (10, 16, 25, 40, 64, 100 tolerance units), a factor 10^(1/5); by the
reciprocal law of Chase and Greenwood (1988) costs step by its inverse, and finer grades are taken to go on so."""
Width = Annotated[float, Field(gt=0, le=2000)]
"""Width of a tolerance zone, upper less lower limit [um]."""


class Cost(Section):
    """Cost of a tolerance, in any currency, alike for all dimensions; `per` element or for all elements together."""

    per: Literal["element", "ring"] = "ring"

    @property
    def example(self) -> bool:
        """Whether a number of it is the program's example and not the maker's own."""
        return False

    @abstractmethod
    def of_one(self, width_um: Real) -> Real:
        """Cost of one element, or of the ring, at widths of the zone (any shape) [um]."""

    @property
    def widths_um(self) -> tuple[float, float]:
        """Widths [um] between which the law is known."""
        return 0.0, np.inf

    def problems(self, key: str) -> Iterator[Mistake]:
        """Contradictions among the settings under the dotted ``key``."""
        yield from ()

    def count(self, name: str, design: Design) -> int:
        """How many times it is paid for the dimension ``name``."""
        elements = dimension_library()[name].elements
        return elements.count(design) if elements and self.per == "element" else 1


class Reciprocal(Cost):
    """fixed + cost (tolerance_um / T): half the zone, twice the cost.

    Source: Chase, Greenwood, Design issues in mechanical tolerance analysis, Manufacturing Review 1 (1988) 50.
    """

    law: Literal["reciprocal"]
    cost: Positive
    tolerance_um: Width
    fixed: NotNegative = 0.0

    @property
    def power(self) -> float:
        """By which the cost falls with the width."""
        return 1.0

    def of_one(self, width_um: Real) -> Real:
        """See `Cost`."""
        return self.fixed + self.cost * (self.tolerance_um / width_um) ** self.power


class Power(Reciprocal):
    """fixed + cost (tolerance_um / T)^exponent.

    Source: Sutherland, Roth, Mechanism design: accounting for manufacturing tolerances and costs in function generating
    problems, J. Eng. Ind. 97 (1975) 283.
    """

    law: Literal["power"]  # type: ignore[assignment]
    exponent: Annotated[float, Field(gt=0, le=10)]

    @property
    def power(self) -> float:
        """By which the cost falls with the width."""
        return self.exponent


class CostTable(Cost):
    """A maker's own table, wider zones costing less; between its rows straight in the logarithms, beyond it nothing."""

    law: Literal["table"]
    tolerances_um: Annotated[tuple[Width, ...], Field(min_length=2, max_length=1000)]
    costs: Annotated[tuple[Positive, ...], Field(min_length=2, max_length=1000)]

    @property
    def widths_um(self) -> tuple[float, float]:
        """Ends of the table [um]."""
        return self.tolerances_um[0], self.tolerances_um[-1]

    def of_one(self, width_um: Real) -> Real:
        """See `Cost`; missing beyond the table."""
        logs = np.interp(np.log(width_um), np.log(self.tolerances_um), np.log(self.costs), left=np.nan, right=np.nan)
        return np.exp(logs)

    def problems(self, key: str) -> Iterator[Mistake]:
        """Columns of different lengths or in the wrong order."""
        if len(self.costs) != len(self.tolerances_um):
            yield Mistake(
                f"{key}.costs", list(self.costs), f"must have {len(self.tolerances_um)} values, as tolerances_um"
            )
        elif np.any(np.diff(self.tolerances_um) <= 0):
            yield Mistake(f"{key}.tolerances_um", list(self.tolerances_um), "must ascend")
        elif np.any(np.diff(self.costs) >= 0):
            yield Mistake(f"{key}.costs", list(self.costs), "must descend: a wider zone costs less")


class IsoGrade(Cost):
    """cost times the relative cost of a grade of ISO 286-1 whose zone at `size_mm` is as wide, that of `grade` being 1.

    A dimension whose micrometres are `of` a radius has half the zone of the diameter that the grades are of. Without
    `relative_costs` of the maker's own, by grade, those of `EXAMPLE_COSTS` stand, which are an example. Between grades
    straight in the logarithms, beyond them nothing.
    """

    law: Literal["iso_grade"]
    cost: Positive
    grade: Annotated[int, Field(ge=min(TOLERANCES_UM), le=max(TOLERANCES_UM))]
    size_mm: Annotated[float, Field(gt=0, le=UP_TO_MM[-1])]
    of: Literal["diameter", "radius"] = "diameter"
    relative_costs: dict[str, Positive] | None = None

    @property
    def example(self) -> bool:
        """Whether the relative costs are those of the example."""
        return self.relative_costs is None

    def _width_um(self, grade: int) -> float:
        """Width of the dimension's zone at a grade, which is one of the diameter."""
        return grade_width_um(grade, self.size_mm) / (2.0 if self.of == "radius" else 1.0)

    @property
    def _steps(self) -> tuple[Real, Real]:
        """Widths [um], ascending, and relative costs of the grades; of grades of equal width the finest."""
        costs = {int(name): cost for name, cost in (self.relative_costs or EXAMPLE_COSTS).items()}
        by_width: dict[float, float] = {}
        for grade in sorted(costs):
            by_width.setdefault(self._width_um(grade), costs[grade])
        return np.array(list(by_width)), np.array(list(by_width.values()))

    @property
    def widths_um(self) -> tuple[float, float]:
        """Widths of the finest and of the coarsest grade [um]."""
        widths, _ = self._steps
        return float(widths[0]), float(widths[-1])

    def of_one(self, width_um: Real) -> Real:
        """See `Cost`; missing beyond the grades."""
        widths, costs = self._steps
        widths_um = np.append(np.asarray(width_um, float), self._width_um(self.grade))
        logs: Real = np.interp(np.log(widths_um), np.log(widths), np.log(costs), left=np.nan, right=np.nan)
        cost: Real = self.cost * np.exp(logs[:-1] - logs[-1]).reshape(np.shape(width_um))
        return cost

    def problems(self, key: str) -> Iterator[Mistake]:
        """Grades that are none, or that do not cost the less the coarser they are."""
        grades = {str(grade) for grade in TOLERANCES_UM}
        relative_costs = self.relative_costs or EXAMPLE_COSTS
        if set(relative_costs) - grades or len(relative_costs) < 2:
            requirement = (
                f"must have two or more of the grades {min(TOLERANCES_UM)} to {max(TOLERANCES_UM)}, as 5 = 1.6"
            )
            yield Mistake(f"{key}.relative_costs", sorted(relative_costs), requirement)
        elif np.any(np.diff([relative_costs[name] for name in sorted(relative_costs, key=int)]) >= 0):
            yield Mistake(
                f"{key}.relative_costs", list(relative_costs.values()), "must descend: a coarser grade costs less"
            )
        elif not min(map(int, relative_costs)) <= self.grade <= max(map(int, relative_costs)):
            yield Mistake(f"{key}.grade", self.grade, "must lie among the grades of relative_costs")


AnyCost = Annotated[Reciprocal | Power | CostTable | IsoGrade, Field(discriminator="law")]


class _Costs(Section):
    """Costs of the tolerances; one that the file does not name is not moved by an allocation."""

    @property
    def of_dimensions(self) -> dict[str, Cost]:
        """The costs that are stated, by dimension."""
        return {name: cost for name in dimension_library() if (cost := getattr(self, name)) is not None}


if TYPE_CHECKING:
    Costs = _Costs
else:
    _of_dimensions = dict.fromkeys(dimension_library(), (AnyCost | None, None))
    Costs = create_model("Costs", __base__=_Costs, __doc__=_Costs.__doc__, **_of_dimensions)


def cost_problems(costs: Mapping[str, Cost]) -> Iterator[Mistake]:
    """What each cost, valid value by value, contradicts in itself."""
    for name, cost in costs.items():
        if cost is not None:
            yield from cost.problems(f"costs.{name}")
