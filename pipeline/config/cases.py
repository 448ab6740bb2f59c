"""Listed samples: each case states the total deviation of every element, in place of distributions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from pipeline.config.design import Design
from pipeline.config.section import Micrometres, Problem, Section
from pipeline.config.tolerances import ONE_SIDED, PIN_TOLERANCES

PerElement = Micrometres | tuple[Micrometres, ...]


class Case(Section):
    """One sample of known deviations [um]; a number stands for all elements alike, a list gives one per element.

    Signs are those of the tolerances. Ovalities are amplitudes with their phase at 0: the pin circle is widest
    along the crank at 0 degrees.
    """

    label: str
    pin_radial: PerElement = 0.0
    pin_tangential: PerElement = 0.0
    pin_radius: PerElement = 0.0
    disk_profile: Micrometres = 0.0
    lobe_profile: PerElement = 0.0
    eccentricity: Micrometres = 0.0
    roller_diameter: PerElement = 0.0
    bearing_clearance: Micrometres = 0.0
    ovality_2: Micrometres = 0.0
    ovality_3: Micrometres = 0.0


def elements(design: Design) -> dict[str, int]:
    """Number of elements of each tolerance that has one deviation per element."""
    counts = dict.fromkeys(PIN_TOLERANCES, design.cycloid.pins)
    return {**counts, "lobe_profile": design.cycloid.lobes, "roller_diameter": design.output.contacts}


def case_problems(cases: Mapping[int, Case], design: Design | None) -> Iterator[Problem]:
    """Lists of the wrong length, negative clearances and amplitudes, and repeated labels.

    Parameters
    ----------
    cases : the valid cases by their position in the file.
    design : the reducer they belong to, None where it could not be read.
    """
    labels: dict[str, int] = {}
    for position, case in cases.items():
        first = labels.setdefault(case.label, position)
        if first != position:
            yield Problem(f"cases[{position}].label", case.label, f"cases[{first}] has it already; labels must differ")
        for name in ONE_SIDED:
            if getattr(case, name) < 0:
                yield Problem(f"cases[{position}].{name}", getattr(case, name), "must be >= 0")
        for name, count in elements(design).items() if design else ():
            value = getattr(case, name)
            if isinstance(value, Sequence) and len(value) != count:
                yield Problem(
                    f"cases[{position}].{name}", f"list of {len(value)}", f"must have {count}, or be a number"
                )
