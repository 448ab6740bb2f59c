"""Deviations of a study; signs are those of the dimensions.

Tolerances are limit deviations about a fit allowance, as on a drawing. A listed case states the total deviation of
every element, in place of distributions.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field, create_model

from pipeline.arrays import Real
from pipeline.config.designs.design import Design
from pipeline.config.dimensions import Dimension, dimension_library
from pipeline.config.distributions import Distribution, Spread, library
from pipeline.config.distributions.shipped import Fixed
from pipeline.config.files.section import Clearance, Micrometres, Mistake, Section

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
        share = tolerance.common_share if isinstance(tolerance, Spread) else None
        if share is not None and dimensions[name].elements is None:
            requirement = f"is of several elements, and {dimensions[name].title} has none; delete it"
            yield Mistake(f"{key}.common_share", share, requirement)
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
        requirement = f"leaves nothing of the nominal {size:g} um; micrometres are asked for"
        yield Mistake(f"tolerances.{dimension.name}.{tolerance.lowest_key}", tolerance.limits_um[0], requirement)


Direction = Annotated[float, Field(ge=-360.0, le=360.0)]
PerElement = Micrometres | tuple[Micrometres, ...]
DirectionPerElement = Direction | tuple[Direction, ...]


def direction_key(dimension: str) -> str:
    """Key of the direction of a dimension in a case."""
    return f"{dimension}_direction_deg"


class _Case(Section):
    """One sample of known deviations [um]; a number stands for all elements alike, a list gives one per element.

    A list of what belongs to the disks runs over one disk after the other.

    Signs are those of the dimensions. One with a direction (run-outs, positions, ovalities) states its amplitude, and
    its direction [degrees] as ``<dimension>_direction_deg``; without that it is 0: the pin circle is widest along the
    crank at 0 degrees.
    """

    label: str

    def deviation_um(self, dimension: str) -> float | tuple[float, ...]:
        """Deviation of a dimension [um], of elements alike or of each."""
        deviation: float | tuple[float, ...] = getattr(self, dimension)
        return deviation

    def direction_rad(self, dimension: str) -> Real:
        """Direction of a dimension [rad], of elements alike () or of each (n_elements,)."""
        return np.asarray(np.radians(getattr(self, direction_key(dimension))))


if TYPE_CHECKING:
    Case = _Case
else:
    _of_dimensions, _of_directions = {}, {}
    for _name, _dimension in dimension_library().items():
        _is_list = bool(_dimension.elements or _dimension.of_disk)
        _of_dimensions[_name] = (PerElement if _is_list else Micrometres, 0.0)
        if _dimension.direction:
            _of_directions[direction_key(_name)] = (DirectionPerElement if _is_list else Direction, 0.0)
    Case = create_model("Case", __base__=_Case, __doc__=_Case.__doc__, **_of_dimensions, **_of_directions)


class GaugedCase(Case):
    """A measured unit, and how well its dimensions are known.

    Attributes
    ----------
    measured_to_um : standard uncertainty of the gauge [um]: once for the error that all elements of a dimension share,
        and once for that of each alone.
    """

    measured_to_um: Clearance = 0.0


def elements(design: Design) -> dict[str, int]:
    """Number of deviations of each dimension that has several: one per element, disk by disk."""
    library = dimension_library().items()
    return {name: dimension.count(design) for name, dimension in library if dimension.elements or dimension.of_disk}


def case_problems(cases: Mapping[int, Case], design: Design | None) -> Iterator[Mistake]:
    """Lists of the wrong length, negative clearances and amplitudes, and repeated labels.

    Parameters
    ----------
    cases : the valid cases by their position in the file.
    design : the reducer they belong to, None where it could not be read.
    """
    labels: dict[str, int] = {}
    for position, case in cases.items():
        earlier_position = labels.setdefault(case.label, position)
        if earlier_position != position:
            yield Mistake(
                f"cases[{position}].label", case.label, f"cases[{earlier_position}] has it already; labels must differ"
            )
        for name, dimension in dimension_library().items():
            if dimension.one_sided and np.min(case.deviation_um(name)) < 0:
                yield Mistake(f"cases[{position}].{name}", getattr(case, name), "must be >= 0")
            key = direction_key(name)
            if dimension.direction and key in case.model_fields_set and name not in case.model_fields_set:
                yield Mistake(f"cases[{position}].{key}", getattr(case, key), f"needs {name}, whose direction it is")
        for name, count in elements(design).items() if design else ():
            value = getattr(case, name)
            if design and count == 0 and np.any(value):
                yield Mistake(f"cases[{position}].{name}", value, dimension_library()[name].refusal(design))
            for key in (name, direction_key(name)):
                listed = getattr(case, key, None)
                if count and isinstance(listed, Sequence) and len(listed) != count:
                    requirement = f"must have {count}, or be a number"
                    yield Mistake(f"cases[{position}].{key}", f"list of {len(listed)}", requirement)
