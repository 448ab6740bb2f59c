"""Tolerances of a study: limit deviations about a fit allowance, as on a drawing.

Signs: `disk_profile` and `lobe_profile` count material taken off the flank (positive gives clearance); `pin_radius` and
`roller_diameter` (of output rollers, or of output pins in the disk's holes) are deviations of size (negative gives
clearance); `pin_radial` is positive outwards, `pin_tangential` counterclockwise; `eccentricity` is positive when
larger; `bearing_clearance` is radial and adds to the design's.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from pipeline.config.design import Design
from pipeline.config.distributions import Distribution, Spread, library
from pipeline.config.distributions.fixed import Fixed
from pipeline.config.section import Problem, Section

PIN_TOLERANCES = ("pin_radial", "pin_tangential", "pin_radius")
OVALITIES = {"ovality_2": 2, "ovality_3": 3}
CORRELATED = (*PIN_TOLERANCES, "lobe_profile")
ONE_SIDED = ("bearing_clearance", *OVALITIES)
"""Tolerances whose total cannot be negative: a clearance and amplitudes."""


if TYPE_CHECKING:
    Tolerance = Distribution
else:
    Tolerance = Annotated[reduce(or_, library().values()), Field(discriminator="distribution")]
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


def tolerance_problems(tolerances: Mapping[str, Distribution], design: Design | None) -> Iterator[Problem]:
    """What each tolerance, valid value by value, contradicts in itself or in the design.

    Parameters
    ----------
    tolerances : the valid tolerances by name.
    design : the reducer they belong to, None where it could not be read.
    """
    for name, tolerance in tolerances.items():
        key = f"tolerances.{name}"
        yield from tolerance.problems(key)
        length = tolerance.correlation_length_mm if isinstance(tolerance, Spread) else None
        if length is not None and name not in CORRELATED:
            allowed = f"only {', '.join(CORRELATED)} lie along a machined circle; delete it"
            yield Problem(f"{key}.correlation_length_mm", length, allowed)
        if name in ONE_SIDED and tolerance.least_um < 0:
            allowed = "must be >= 0, and with allowance_um added too"
            yield Problem(f"{key}.{tolerance.lowest_key}", tolerance.limits_um[0], allowed)
        if design is not None:
            yield from _size_problems(name, tolerance, design)


def _size_problems(name: str, tolerance: Distribution, design: Design) -> Iterator[Problem]:
    sizes_um = {
        "pin_radius": 1e3 * design.cycloid.pin_radius_mm,
        "eccentricity": 1e3 * design.cycloid.eccentricity_mm,
        "roller_diameter": 2e3 * design.output.contact_radius_mm,
    }
    if name in sizes_um and tolerance.allowance_um + tolerance.limits_um[0] <= -sizes_um[name]:
        yield Problem(
            f"tolerances.{name}.{tolerance.lowest_key}",
            tolerance.limits_um[0],
            f"leaves nothing of the nominal {sizes_um[name]:g} um; micrometres are asked for",
        )
