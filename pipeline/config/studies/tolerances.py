"""Tolerances of a study: limit deviations about a fit allowance, as on a drawing; signs are those of the dimensions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated

from pydantic import Field, create_model

from pipeline.config.designs.design import Design
from pipeline.config.dimensions import Dimension, dimension_library
from pipeline.config.distributions import Distribution, Spread, library
from pipeline.config.distributions.along_line import Fixed
from pipeline.config.files.section import Mistake, Section

if TYPE_CHECKING:
    Tolerance = Distribution
else:
    Tolerance = Annotated[reduce(or_, library().values()), Field(discriminator="distribution")]
_NONE = Fixed(distribution="fixed", value_um=0.0)


class _Tolerances(Section):
    """All tolerances of a study; one that the file does not name is zero."""


if TYPE_CHECKING:
    Tolerances = _Tolerances
else:
    _of_dimensions = dict.fromkeys(dimension_library(), (Tolerance, _NONE))
    Tolerances = create_model("Tolerances", __base__=_Tolerances, __doc__=_Tolerances.__doc__, **_of_dimensions)


def tolerance_problems(tolerances: Mapping[str, Distribution], design: Design | None) -> Iterator[Mistake]:
    """What each tolerance, valid value by value, contradicts in itself or in the design.

    Parameters
    ----------
    tolerances : the valid tolerances by name.
    design : the reducer they belong to, None where it could not be read.
    """
    dimensions = dimension_library()
    circular_dimensions = [
        name for name, dimension in dimensions.items() if dimension.elements and dimension.elements.radius_mm
    ]
    for name, tolerance in tolerances.items():
        key = f"tolerances.{name}"
        yield from tolerance.problems(key)
        length = tolerance.correlation_length_mm if isinstance(tolerance, Spread) else None
        if length is not None and name not in circular_dimensions:
            requirement = f"only {', '.join(circular_dimensions)} lie along a machined circle; delete it"
            yield Mistake(f"{key}.correlation_length_mm", length, requirement)
        yield from _zone_problems(dimensions[name], tolerance)
        if dimensions[name].one_sided and tolerance.least_um < 0:
            requirement = "must be >= 0, and with allowance_um added too"
            yield Mistake(f"{key}.{tolerance.lowest_key}", tolerance.limits_um[0], requirement)
        if design is not None:
            yield from _size_problems(dimensions[name], tolerance, design)


def _zone_problems(dimension: Dimension, tolerance: Distribution) -> Iterator[Mistake]:
    key = f"tolerances.{dimension.name}.distribution"
    if dimension.zone and tolerance.varies and not tolerance.in_disc:
        requirement = (
            'is of a number, and this is a point in a zone: write position = "dia 0.02" (mm) in place of limits'
        )
        yield Mistake(key, tolerance.name, requirement)
    if tolerance.in_disc and not dimension.zone:
        requirement = f"is of a point in a zone, and {dimension.title} is a number; take one with limits"
        yield Mistake(key, tolerance.name, requirement)


def _size_problems(dimension: Dimension, tolerance: Distribution, design: Design) -> Iterator[Mistake]:
    if dimension.count(design) == 0:
        if tolerance != _NONE:
            yield Mistake(f"tolerances.{dimension.name}", None, dimension.refusal(design))
        return
    if dimension.size_um is None:
        return
    size = dimension.size_um(design)
    if tolerance.allowance_um + tolerance.limits_um[0] <= -size:
        yield Mistake(
            f"tolerances.{dimension.name}.{tolerance.lowest_key}",
            tolerance.limits_um[0],
            f"leaves nothing of the nominal {size:g} um; micrometres are asked for",
        )
