"""Stage 1: manufacturing errors of every sample, per pin, lobe and roller."""

import numpy as np

from pipeline.engine.stage import Chunk, Job, Stage, Tables
from pipeline.engine.table import Column, Table
from pipeline.sampling import Errors, draw
from stages.keys import SAMPLE as SAMPLE_COLUMN
from stages.keys import repeated

REDUCER_ERRORS = {
    "eccentricity_um": ("eccentricity", "um", "eccentricity error, larger positive"),
    "disk_profile_um": ("disk_profile", "um", "material off the whole flank, as the study reads it"),
    "bearing_clearance_um": ("bearing_clearance", "um", "radial clearance of the input bearing beyond the design's"),
    "ovality_2_amplitude_um": ("ovality_2_amplitude", "um", "two-lobed ovality of the pin circle, part of radial_um"),
    "ovality_2_phase_rad": ("ovality_2_phase", "rad", "direction in which the pin circle is widest"),
    "ovality_3_amplitude_um": ("ovality_3_amplitude", "um", "three-lobed ovality of the pin circle, part of radial_um"),
    "ovality_3_phase_rad": ("ovality_3_phase", "rad", "direction in which the pin circle is widest"),
}
PIN_ERRORS = {
    "radial_um": ("pin_radial", "um", "position error outwards, ovalities included"),
    "tangential_um": ("pin_tangential", "um", "position error counterclockwise"),
    "radius_um": ("pin_radius", "um", "radius error, larger positive"),
}


def _columns(errors: dict[str, tuple[str, str, str]]) -> tuple[Column, ...]:
    return tuple(Column(name, "float64", unit, meaning) for name, (_, unit, meaning) in errors.items())


REDUCER = Table("reducer", "sample", (SAMPLE_COLUMN, *_columns(REDUCER_ERRORS)))
PINS = Table(
    "pins", "sample, pin", (SAMPLE_COLUMN, Column("pin", "int32", "1", "pin, clockwise"), *_columns(PIN_ERRORS))
)
LOBES = Table(
    "lobes",
    "sample, disk, lobe",
    (
        SAMPLE_COLUMN,
        Column("disk", "int32", "1", "disk"),
        Column("lobe", "int32", "1", "lobe, clockwise"),
        Column("profile_um", "float64", "um", "material off this lobe's flank besides disk_profile_um"),
    ),
)
ROLLERS = Table(
    "rollers",
    "sample, interface, roller",
    (
        SAMPLE_COLUMN,
        Column("interface", "int32", "1", "0: disk and plate, 1: plate and output; pins in holes: 0"),
        Column(
            "roller", "int32", "1", "roller of the interface: by face, end, and from outside to inside; or output pin"
        ),
        Column("diameter_um", "float64", "um", "diameter error, larger positive"),
    ),
)


def columns_of_errors(errors: Errors, start: int, interfaces: int) -> Tables:
    """The four tables of errors whose first sample is ``start``."""
    number = np.arange(start, start + len(errors))
    one = {name: getattr(errors, field) for name, (field, _, _) in REDUCER_ERRORS.items()}
    sample, pin = repeated(number, np.arange(errors.pin_radial.shape[1]))
    pins = {name: getattr(errors, field).ravel() for name, (field, _, _) in PIN_ERRORS.items()}
    lobe_sample, disk, lobe = repeated(number, np.zeros(1, int), np.arange(errors.lobe_profile.shape[1]))
    per_interface = errors.roller_diameter.shape[1] // interfaces
    roller_sample, interface, roller = repeated(number, np.arange(interfaces), np.arange(per_interface))
    return {
        "reducer": {"sample": number, **one},
        "pins": {"sample": sample, "pin": pin, **pins},
        "lobes": {"sample": lobe_sample, "disk": disk, "lobe": lobe, "profile_um": errors.lobe_profile.ravel()},
        "rollers": {
            "sample": roller_sample,
            "interface": interface,
            "roller": roller,
            "diameter_um": errors.roller_diameter.ravel(),
        },
    }


def errors_of_columns(tables: Tables) -> Errors:
    """The errors of whole samples read back from the four tables."""
    n = len(tables["reducer"]["sample"])
    fields = {field: tables["reducer"][name] for name, (field, _, _) in REDUCER_ERRORS.items()}
    fields |= {field: tables["pins"][name].reshape(n, -1) for name, (field, _, _) in PIN_ERRORS.items()}
    fields["lobe_profile"] = tables["lobes"]["profile_um"].reshape(n, -1)
    fields["roller_diameter"] = tables["rollers"]["diameter_um"].reshape(n, -1)
    return Errors(**fields)


def _solve(study, chunk: Chunk) -> Tables:
    return columns_of_errors(draw(study, chunk.start, chunk.stop), chunk.start, study.design.output.interfaces)


def _items(job: Job) -> int:
    return job.study.samples.rows


def _prepare(job: Job):
    return job.study


SAMPLE = Stage(
    name="sample",
    reads=(),
    sections=("samples", "tolerances", "cases", "design.cycloid", "design.output.contacts", "design.output.interfaces"),
    tables=(REDUCER, PINS, LOBES, ROLLERS),
    module="stages.sample",
    unit="samples",
    items=_items,
    prepare=_prepare,
    solve=_solve,
)
