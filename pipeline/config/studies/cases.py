"""Listed samples: each case states the total deviation of every element, in place of distributions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from pydantic import create_model

from pipeline.config.designs.design import Design
from pipeline.config.dimensions import dimension_library
from pipeline.config.files.section import Micrometres, Mistake, Section

PerElement = Micrometres | tuple[Micrometres, ...]


class _Case(Section):
    """One sample of known deviations [um]; a number stands for all elements alike, a list gives one per element.

    A list of what belongs to the disks runs over one disk after the other.

    Signs are those of the dimensions. Ovalities are amplitudes with their phase at 0: the pin circle is widest
    along the crank at 0 degrees.
    """

    label: str

    def deviation_um(self, dimension: str) -> float | tuple[float, ...]:
        """Deviation of a dimension [um], of elements alike or of each."""
        return getattr(self, dimension)


if TYPE_CHECKING:
    Case = _Case
else:
    _of_dimensions = {
        name: (PerElement if dimension.elements or dimension.of_disk else Micrometres, 0.0)
        for name, dimension in dimension_library().items()
    }
    Case = create_model("Case", __base__=_Case, __doc__=_Case.__doc__, **_of_dimensions)


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
        for name, count in elements(design).items() if design else ():
            value = getattr(case, name)
            if design and count == 0 and np.any(value):
                yield Mistake(f"cases[{position}].{name}", value, dimension_library()[name].refusal(design))
            elif count and isinstance(value, Sequence) and len(value) != count:
                yield Mistake(
                    f"cases[{position}].{name}", f"list of {len(value)}", f"must have {count}, or be a number"
                )
