"""Points in a circular zone, as the way of each from the zone's centre; its direction is drawn beside it."""

from collections.abc import Callable, Iterator
from typing import ClassVar

from pipeline.config.distributions.distribution import Distribution
from pipeline.config.files.section import Clearance


class InDisc(Distribution):
    """A point in a disc of the radius `radius_um`, half of the zone's diameter."""

    lowest_key: ClassVar[str] = "radius_um"
    in_disc: ClassVar[bool] = True

    radius_um: Clearance

    @property
    def limits_um(self) -> tuple[float, float]:
        """Least and largest way from the centre [um]."""
        return 0.0, self.radius_um

    def details(self, number_text: Callable[[float], str]) -> Iterator[str]:
        """The zone as a drawing has it."""
        yield f"zone of diameter {number_text(2 * self.radius_um)} µm"
