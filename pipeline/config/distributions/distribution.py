"""What a distribution declares, what all between two limits share, and the library of all."""

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import Annotated, Any, ClassVar, get_args

import numpy as np
from pydantic import Field

from pipeline.arrays import Real
from pipeline.config.files.section import Micrometres, Millimetres, Mistake, Section
from pipeline.registry import DISTRIBUTIONS

MIDPOINTS = 512
"""Of the range of a probability, over which the mean of a distribution is taken."""


class Distribution(Section):
    """Settings of a tolerance: its distribution, limits and allowance.

    A subclass has a field ``distribution: Literal["<name>"]``, by which the file chooses it.

    Attributes
    ----------
    name : as the file has it.
    varies : whether the deviation differs from sample to sample.
    lowest_key : the setting that is its lower limit.
    in_disc : whether it is the way of a point in a circular zone from the zone's centre.
    allowance_um : added to every deviation.
    """

    name: ClassVar[str]
    varies: ClassVar[bool] = True
    lowest_key: ClassVar[str] = "lower_um"
    in_disc: ClassVar[bool] = False

    allowance_um: Micrometres = 0.0

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        if "distribution" in cls.model_fields:
            (cls.name,) = get_args(cls.model_fields["distribution"].annotation)

    @property
    @abstractmethod
    def limits_um(self) -> tuple[float, float]:
        """Lower and upper limit of the deviation [um]."""

    @property
    def least_um(self) -> float:
        """Smallest deviation [um], whether the allowance counts or not."""
        return min(self.allowance_um, self.allowance_um + self.limits_um[0])

    @abstractmethod
    def deviation(self, probability: Real) -> Real:
        """Deviation [um] within the limits whose distribution function is `probability` (any shape), in [0, 1]."""

    @property
    def average_um(self) -> float:
        """Mean of the deviation [um], without the allowance."""
        return float(np.mean(self.deviation((np.arange(MIDPOINTS) + 0.5) / MIDPOINTS)))

    def density(self, deviation: Real) -> Real:
        """Probability density [1/um] at deviations (any shape) [um]; 0 beyond the limits.

        Raises
        ------
        TypeError
            If the distribution has none.
        """
        raise TypeError(f"{self.name} has no density")

    def scaled_by(self, factor: float) -> "Distribution":
        """The same distribution, all but its allowance times ``factor``."""
        lengths = (name for name in type(self).model_fields if name.endswith("_um") and name != "allowance_um")
        values = {name: value for name in lengths if (value := getattr(self, name)) is not None}
        return self.model_copy(update={name: factor * value for name, value in values.items()})

    def problems(self, key: str) -> Iterator[Mistake]:
        """Contradictions among the settings under the dotted ``key``, each of which is allowed."""
        yield from ()

    def details(self, number_text: Callable[[float], str]) -> Iterator[str]:
        """What the report tells beside the limits; ``number_text`` writes a number."""
        yield from ()


class Spread(Distribution):
    """A deviation between two limits.

    Attributes
    ----------
    within_limits : settings that must lie within the limits.
    correlation_length_mm : arc over which the correlation of neighbours on a circle falls to 1/e, exponentially.
    common_share : share of the variance that all elements of a part have in common, as those of one batch.
    """

    within_limits: ClassVar[tuple[str, ...]] = ()

    lower_um: Micrometres
    upper_um: Micrometres
    correlation_length_mm: Millimetres | None = None
    common_share: Annotated[float, Field(gt=0, le=1)] | None = None

    @property
    def limits_um(self) -> tuple[float, float]:
        """Lower and upper limit of the deviation [um]."""
        return self.lower_um, self.upper_um

    @property
    def middle_um(self) -> float:
        """Middle of the tolerance zone [um]."""
        return (self.lower_um + self.upper_um) / 2

    def problems(self, key: str) -> Iterator[Mistake]:
        """Limits in the wrong order, and settings outside of them."""
        lower, upper = self.limits_um
        if lower >= upper:
            yield Mistake(
                f"{key}.upper_um", upper, f'must be > lower_um = {lower:g}; for one value take distribution = "fixed"'
            )
            return
        for name in self.within_limits:
            value = getattr(self, name)
            if value is not None and not lower <= value <= upper:
                yield Mistake(f"{key}.{name}", value, f"must lie within the limits {lower:g} to {upper:g}")

    def details(self, number_text: Callable[[float], str]) -> Iterator[str]:
        """The correlation along the circle, and of all elements."""
        if self.correlation_length_mm is not None:
            yield f"correlated over {number_text(self.correlation_length_mm)} mm"
        if self.common_share is not None:
            yield f"{number_text(100 * self.common_share)} % of the variance common to all elements"


@cache
def library() -> Mapping[str, type[Distribution]]:
    """All distributions by name: the files beside this one and what packages register."""
    return DISTRIBUTIONS.declarations()
