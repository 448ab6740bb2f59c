"""Tolerances of a study: limit deviations about a fit allowance, as on a drawing, and how they are distributed.

Signs: `disk_profile` and `lobe_profile` count material taken off the flank (positive gives clearance); `pin_radius` and
`roller_diameter` (of output rollers, or of output pins in the disk's holes) are deviations of size (negative gives
clearance); `pin_radial` is positive outwards, `pin_tangential` counterclockwise; `eccentricity` is positive when
larger; `bearing_clearance` is radial and adds to the design's.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

from pipeline.config.design import Design
from pipeline.config.section import Clearance, Micrometres, Millimetres, Problem, Section

PIN_TOLERANCES = ("pin_radial", "pin_tangential", "pin_radius")
OVALITIES = {"ovality_2": 2, "ovality_3": 3}
CORRELATED = (*PIN_TOLERANCES, "lobe_profile")
ONE_SIDED = ("bearing_clearance", *OVALITIES)
"""Tolerances whose total cannot be negative: a clearance and amplitudes."""


class Fixed(Section):
    """The same deviation in every sample."""

    distribution: Literal["fixed"]
    value_um: Micrometres
    allowance_um: Micrometres = 0.0

    @property
    def limits_um(self) -> tuple[float, float]:
        """Lower and upper limit of the deviation [um]."""
        return self.value_um, self.value_um


class Spread(Section):
    """A deviation between two limits."""

    lower_um: Micrometres
    upper_um: Micrometres
    allowance_um: Micrometres = 0.0
    correlation_length_mm: Millimetres | None = None

    @property
    def limits_um(self) -> tuple[float, float]:
        """Lower and upper limit of the deviation [um]."""
        return self.lower_um, self.upper_um

    @property
    def middle_um(self) -> float:
        """Middle of the tolerance zone [um]."""
        return (self.lower_um + self.upper_um) / 2


class Normal(Spread):
    """Normal distribution truncated at the limits; unless stated, centred between them with limits at 3 sigma."""

    distribution: Literal["normal"]
    sigma_um: Clearance | None = None
    mean_um: Micrometres | None = None

    @property
    def location_um(self) -> float:
        """Mean before truncation [um]."""
        return self.middle_um if self.mean_um is None else self.mean_um

    @property
    def scale_um(self) -> float:
        """Standard deviation before truncation [um]."""
        return (self.upper_um - self.lower_um) / 6 if self.sigma_um is None else self.sigma_um


class Uniform(Spread):
    """Every deviation between the limits equally likely."""

    distribution: Literal["uniform"]


class Triangular(Spread):
    """Density rising from the lower limit to the mode and falling to the upper limit."""

    distribution: Literal["triangular"]
    mode_um: Micrometres | None = None

    @property
    def peak_um(self) -> float:
        """Most likely deviation [um]."""
        return self.middle_um if self.mode_um is None else self.mode_um


Tolerance = Annotated[Fixed | Normal | Uniform | Triangular, Field(discriminator="distribution")]
_NONE = Fixed(distribution="fixed", value_um=0.0)


class Tolerances(Section):
    """All tolerances of a study; one that the file does not name is zero."""

    pin_radial: Tolerance = _NONE
    pin_tangential: Tolerance = _NONE
    pin_radius: Tolerance = _NONE
    disk_profile: Tolerance = _NONE
    lobe_profile: Tolerance = _NONE
    eccentricity: Tolerance = _NONE
    roller_diameter: Tolerance = _NONE
    bearing_clearance: Tolerance = _NONE
    ovality_2: Tolerance = _NONE
    ovality_3: Tolerance = _NONE


def tolerance_problems(tolerances: Mapping[str, Any], design: Design | None) -> Iterator[Problem]:
    """What each tolerance, valid value by value, contradicts in itself or in the design.

    Parameters
    ----------
    tolerances : the valid tolerances by name.
    design : the reducer they belong to, None where it could not be read.
    """
    for name, tolerance in tolerances.items():
        key = f"tolerances.{name}"
        if isinstance(tolerance, Spread):
            yield from _limit_problems(key, tolerance)
            if tolerance.correlation_length_mm is not None and name not in CORRELATED:
                yield Problem(
                    f"{key}.correlation_length_mm",
                    tolerance.correlation_length_mm,
                    f"only {', '.join(CORRELATED)} lie along a machined circle; delete it",
                )
        if name in ONE_SIDED and min(tolerance.allowance_um, tolerance.allowance_um + tolerance.limits_um[0]) < 0:
            which = "value_um" if isinstance(tolerance, Fixed) else "lower_um"
            yield Problem(f"{key}.{which}", tolerance.limits_um[0], "must be >= 0, and with allowance_um added too")
        if design is not None:
            yield from _size_problems(name, tolerance, design)


def _limit_problems(key: str, tolerance: Spread) -> Iterator[Problem]:
    lower, upper = tolerance.limits_um
    if lower >= upper:
        yield Problem(
            f"{key}.upper_um", upper, f'must be > lower_um = {lower:g}; for one value take distribution = "fixed"'
        )
        return
    centre = {"mean_um": getattr(tolerance, "mean_um", None), "mode_um": getattr(tolerance, "mode_um", None)}
    for which, value in centre.items():
        if value is not None and not lower <= value <= upper:
            yield Problem(f"{key}.{which}", value, f"must lie within the limits {lower:g} to {upper:g}")


def _size_problems(name: str, tolerance: Fixed | Spread, design: Design) -> Iterator[Problem]:
    sizes_um = {
        "pin_radius": 1e3 * design.cycloid.pin_radius_mm,
        "eccentricity": 1e3 * design.cycloid.eccentricity_mm,
        "roller_diameter": 2e3 * design.output.contact_radius_mm,
    }
    if name in sizes_um and tolerance.allowance_um + tolerance.limits_um[0] <= -sizes_um[name]:
        which = "value_um" if isinstance(tolerance, Fixed) else "lower_um"
        yield Problem(
            f"tolerances.{name}.{which}",
            tolerance.limits_um[0],
            f"leaves nothing of the nominal {sizes_um[name]:g} um; micrometres are asked for",
        )
