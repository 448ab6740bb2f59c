"""What the fit of Table 2 and the elastic part owe to each assumption: the study with one thing changed at a time."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import cast

import numpy as np

from pipeline import assembly
from pipeline.checks.calibrate import FittedNumber
from pipeline.checks.response import Condensed, with_numbers
from pipeline.config import Study
from pipeline.config.mechanisms.roller_plate import RollerPlate
from pipeline.model.geometry.clearance import DISK_READINGS, ROLLER_READINGS

HALF_PIN_PITCH = 0.5
"""Turn of the pin circle, in pin pitches, that puts the eccentric between two pins."""
FREED_FACTORS = (
    ("thickness of the disk", "disk.thickness_mm", 0.5, 8.0),
    ("exponent of the bearing", "bearing.exponent", 1.0, 4.0),
)
"""Numbers of the design that are fitted besides the calibrated ones: name, key, lower and upper bound."""
FREED_EFFECTS = (
    ("a linear compliance at the pins", "seat_compliance", "compliance_um_per_N", 1e-4, 1e-5, 10.0),
    ("a torsion behind the output", "output_torsion", "compliance_arcmin_per_Nm", 1e-3, 1e-5, 1.0),
    ("a clearance of the bearing", "bearing_clearance", "clearance_um", 0.1, 1e-3, 3.0),
)
"""Effects of which one number is fitted besides: name, effect, its parameter, start, lower and upper bound."""
FRICTION = (
    ("friction of 0.1 N m on the output", {"coulomb": {"torque_Nm": 0.1}}),
    ("friction of a tenth of the torque on the output", {"load_friction": {"coefficient": 0.1}}),
    ("friction at the pins, coefficient 0.1", {"contact_friction": {"coefficient": 0.1}}),
)
"""Friction: name and the effects of the design."""
PLATES = (("a tenth as elastic", 0.1), ("as elastic", 1.0))
"""How elastic plate and output are beside the disk."""


@dataclass(frozen=True)
class Assumption:
    """The study with one assumption changed.

    Attributes
    ----------
    remesh : whether the condensed disk changes with it.
    freed_numbers : numbers that are fitted besides the calibrated ones.
    tied : what follows from the fitted numbers, from study to study; None: nothing.
    plate : compliance of plate and output under their rollers over the disk's.
    backlash_percent : of the rated torque, where the backlash is read; 0 is the limit of no torque.
    """

    name: str
    study: Study
    remesh: bool = False
    freed_numbers: tuple[FittedNumber, ...] = ()
    tied: Callable[[Study], Study] | None = None
    plate: float = 0.0
    backlash_percent: float = 0.0


def _with_design_values(study: Study, section: str, **values: object) -> Study:
    return study.model_copy(update={"design": study.design.with_section(section, **values)})


def _with_effects(study: Study, effects: dict[str, dict[str, float]]) -> Study:
    return study.with_section("design", effects=effects)


def readings(study: Study) -> Iterator[Assumption]:
    """Every reading of the tolerances D of the disk and R of the rollers."""
    for disk in DISK_READINGS:
        for roller in ROLLER_READINGS:
            yield Assumption(
                f"{disk}, {roller}", study.with_section("clearance", disk_reading=disk, roller_reading=roller)
            )


def assumptions(study: Study) -> Iterator[Assumption]:
    """The declared study, then one change at a time."""
    yield Assumption("as declared", study)
    yield from _definitions(study)
    yield from _bearing_and_contacts(study)
    yield from _disk(study)
    yield from _output(study)
    yield from _softer(study)
    for name, effects in FRICTION:
        yield Assumption(name, _with_effects(study, effects))


def _definitions(study: Study) -> Iterator[Assumption]:
    for low in (3.0, 10.0, 25.0, 50.0):
        variant = study.with_section("metrics", rigidity_percent=(low, 100.0))
        yield Assumption(f"rigidity between {low:g} and 100 % of the rated torque", variant)
    for percent in (2.5, 4.0):
        variant = study.with_section("metrics", lost_motion_percent=percent)
        yield Assumption(f"lost motion at {percent:g} % of the rated torque", variant)
    yield Assumption("backlash read at 0.1 % of the rated torque", study, backlash_percent=0.1)
    yield Assumption("clearances to first order", study.with_section("clearance", method="first_order"))
    pitch = 360 / study.design.cycloid.pins
    for name, share in (("half a pin pitch", HALF_PIN_PITCH), ("a quarter of a turn", study.design.cycloid.pins / 4)):
        yield Assumption(f"crank {name} on", study.with_section("cycle", crank_deg=(share * pitch,)), remesh=True)


def _bearing_and_contacts(study: Study) -> Iterator[Assumption]:
    for name, exponent in (("linear", 1.0), ("of rollers, exponent 10/9", 10 / 9)):
        yield Assumption(f"input bearing {name}", _with_design_values(study, "bearing", exponent=exponent))
    yield Assumption("Palmgren's law in place of Hertz'", study.with_section("springs", law="palmgren"))
    wider = 2 * study.reduce.patch_half_width_mm
    name = f"pressure patches of the pins {wider:g} mm in half width"
    yield Assumption(name, study.with_section("reduce", patch_half_width_mm=wider), remesh=True)


def _disk(study: Study) -> Iterator[Assumption]:
    for thickness in (1.0, 1.5, 3.0):
        yield Assumption(f"disk {thickness:g} mm thick", _with_design_values(study, "disk", thickness_mm=thickness))
    yield Assumption("plane strain", _with_design_values(study, "disk", stress="plane_strain"), remesh=True)
    for bore, face in ((3.0, 5.0), (8.0, 9.5)):
        variant = with_numbers(study, {"disk.bore_radius_mm": bore, "output.face_offset_mm": face})
        yield Assumption(f"bore {bore:g} mm in radius, rollers {face:g} mm off the axis", variant, remesh=True)


def _output(study: Study) -> Iterator[Assumption]:
    yield Assumption("sliding plate floats", _with_design_values(study, "output", plate="floats"))
    for depth in (1.5, 10.0):
        yield Assumption(
            f"flats under the rollers {depth:g} mm deep", _with_design_values(study, "output", flat_depth_mm=depth)
        )
    width = 0.5 * study.reduce.roller_patch_half_width_mm
    name = f"rollers spread over {width:g} mm in half width"
    yield Assumption(name, study.with_section("reduce", roller_patch_half_width_mm=width), remesh=True)
    turned_slide = _with_design_values(study, "output", slide_angle_deg=0.0)
    yield Assumption("first slide along the crank", turned_slide, remesh=True)
    yield Assumption("R on the first slide alone, and whole on each side", _on_first_slide(study))
    yield from _stations(study)


def _stations(study: Study) -> Iterator[Assumption]:
    """The rollers of a row 4 mm apart, and touching; then what stiffens the disk or the flats besides."""
    yield Assumption("rollers of a row 4 mm apart", _with_roller_pitch(study, 4.0), remesh=True)
    yield Assumption("rollers of a row touching", _touching(study), remesh=True, tied=_touching)
    shallow = _with_design_values(_touching(study), "output", flat_depth_mm=1.5)
    yield Assumption("rollers touching, flats 1.5 mm deep", shallow, remesh=True, tied=_touching)
    small = with_numbers(_touching(study), {"disk.bore_radius_mm": 8.0, "output.face_offset_mm": 9.5})
    name = "rollers touching and 9.5 mm off the axis, bore 8 mm in radius"
    yield Assumption(name, small, remesh=True, tied=_touching)
    thick = _with_design_values(_touching(study), "disk", thickness_mm=3.8)
    name = "rollers touching, disk 3.8 mm thick, rigidity between 6 and 100 %"
    yield Assumption(name, thick.with_section("metrics", rigidity_percent=(6.0, 100.0)), remesh=True, tied=_touching)


def _with_roller_pitch(study: Study, pitch: float) -> Study:
    """The rollers of a row ``pitch`` [mm] apart, counted from the outermost."""
    output = cast(RollerPlate, study.design.output)
    return _with_design_values(
        study, "output", inner_station_mm=output.outer_station_mm - pitch * (output.stations - 1)
    )


def _touching(study: Study) -> Study:
    """The rollers of a row against each other."""
    return _with_roller_pitch(study, 2 * study.design.output.contact_radius_mm)


def _on_first_slide(study: Study) -> Study:
    """Twice R on the rollers of the first slide, none on those of the second: the same backlash."""
    reducer = assembly.reducer(study.design, study.cycle.crank_deg[0])
    share = 2.0 * (reducer.contacts.interface[reducer.n_pins :] == 0)
    rollers = [np.asarray(case.deviation_um("roller_diameter")) * share for case in study.cases]
    cases = tuple(
        case.model_copy(update={"roller_diameter": tuple(errors.tolist())})
        for case, errors in zip(study.cases, rollers, strict=True)
    )
    return study.model_copy(update={"cases": cases})


def _softer(study: Study) -> Iterator[Assumption]:
    for name, key, lower, upper in FREED_FACTORS:
        yield Assumption(f"{name} fitted besides", study, freed_numbers=(FittedNumber(key, lower, upper),))
    for name, effect, value, start, lower, upper in FREED_EFFECTS:
        freed_number = FittedNumber(f"effects.{effect}.{value}", lower, upper)
        yield Assumption(
            f"{name} fitted besides", _with_effects(study, {effect: {value: start}}), freed_numbers=(freed_number,)
        )
    for name, plate in PLATES:
        yield Assumption(f"plate and output {name} as the disk", study, plate=plate)


def with_elastic_plate(study: Study, disk: Condensed, share: float) -> Condensed:
    """The disk, and a plate and an output that give way under their rollers by a share of what the disk does.

    Either slide then has a second elastic body and the second slide two, each with the compliance between the rollers
    of the first slide, times ``share``; what the rollers of one slide do to those of the other is left out.
    """
    contacts = assembly.reducer(study.design, study.cycle.crank_deg[0]).contacts
    of_disk, of_output = (np.flatnonzero(contacts.interface == slide) for slide in (0, 1))
    interval = share * disk.matrix[np.ix_(of_disk, of_disk)]
    matrix = disk.matrix.copy()
    matrix[np.ix_(of_disk, of_disk)] += interval
    matrix[np.ix_(of_output, of_output)] += 2 * interval
    return Condensed(matrix)
