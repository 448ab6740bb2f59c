"""What a tolerance costs: of each dimension the cost of one element, or of the whole ring, against its zone."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, create_model

from pipeline.config.design import Design
from pipeline.config.dimensions import dimension_library
from pipeline.config.section import NotNegative, Positive, Problem, Section

Real = NDArray[np.float64]
Width = Annotated[float, Field(gt=0, le=2000)]
"""Width of a tolerance zone, upper less lower limit [um]."""


class Cost(Section):
    """Cost of a tolerance, in any currency, alike for all dimensions; `per` element or for all elements together."""

    per: Literal["element", "ring"] = "ring"

    @abstractmethod
    def of_one(self, width_um: Real) -> Real:
        """Cost of one element, or of the ring, at widths of the zone (any shape) [um]."""

    @property
    def widths_um(self) -> tuple[float, float]:
        """Widths [um] between which the law is known."""
        return 0.0, np.inf

    def problems(self, key: str) -> Iterator[Problem]:
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

    def problems(self, key: str) -> Iterator[Problem]:
        """Columns of different lengths or in the wrong order."""
        if len(self.costs) != len(self.tolerances_um):
            yield Problem(
                f"{key}.costs", list(self.costs), f"must have {len(self.tolerances_um)} values, as tolerances_um"
            )
        elif np.any(np.diff(self.tolerances_um) <= 0):
            yield Problem(f"{key}.tolerances_um", list(self.tolerances_um), "must ascend")
        elif np.any(np.diff(self.costs) >= 0):
            yield Problem(f"{key}.costs", list(self.costs), "must descend: a wider zone costs less")


AnyCost = Annotated[Reciprocal | Power | CostTable, Field(discriminator="law")]


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


def cost_problems(costs: Mapping[str, Cost]) -> Iterator[Problem]:
    """What each cost, valid value by value, contradicts in itself."""
    for name, cost in costs.items():
        if cost is not None:
            yield from cost.problems(f"costs.{name}")
