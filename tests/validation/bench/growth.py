"""How the time of a loop grows with the pins and the disks of a reducer, on a made-up compliance."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from pipeline import assembly
from pipeline.config import Design, Study
from pipeline.model.load_history.load_cycle import solve_cycle
from pipeline.mounting import drive_of
from pipeline.sampling.errors import draw
from tests.validation.bench.rates import seconds_of
from tests.validation.bench.table import Result

PINS = 20, 80, 200
"""Numbers of pins whose loops are timed."""
DISKS = 1, 2, 3
"""Numbers of disks whose loops are timed."""
UNITS = 50
"""Units of each timing."""
CRANK_DEG = 37.0
"""An angle without symmetry [deg]."""
COMPLIANCE, REACH = 1e-6, 3.0
"""Of a contact [mm/N], and contacts after which that of another has fallen to 1/e of it."""


def growth(study: Study, several_disks: Study) -> Iterator[Result]:
    """Microseconds of a loop of the metrics with more pins of one shape of the profile, and with more disks."""
    cycloid = study.design.cycloid
    for pins in PINS:
        ratio = cycloid.pins / pins
        shape = {"eccentricity_mm": ratio * cycloid.eccentricity_mm, "pin_radius_mm": ratio * cycloid.pin_radius_mm}
        changes = {f"cycloid.{key}": value for key, value in ({"pins": pins} | shape).items()}
        design = study.design.with_(changes | {"housing.outer_diameter_mm": 3 * cycloid.pin_circle_radius_mm})
        yield Result("loop_microseconds", _loop_us(study, design), "us", UNITS, 1, f"{pins} pins")
    for count in DISKS:
        design = several_disks.design.with_({"disk.count": count, "disk.clocking": "own_holes"})
        note = f"{count} disks of {design.cycloid.pins} pins"
        yield Result("loop_microseconds", _loop_us(several_disks, design), "us", UNITS, 1, note)


def _loop_us(study: Study, design: Design) -> float:
    sizes = {"design": design, "samples": study.samples.model_copy(update={"count": UNITS})}
    study = study.model_copy(update=sizes)
    sampled = draw(study, 0, UNITS)
    reducer = assembly.reducer(study.design, CRANK_DEG)
    compliance = np.zeros((len(reducer.contacts), len(reducer.contacts)))
    for disk in range(reducer.n_disks):
        rows = assembly.disk_contacts(reducer, disk)
        compliance[np.ix_(rows, rows)] = COMPLIANCE * np.exp(-np.abs(np.subtract.outer(rows, rows)) / REACH)
    clearance = assembly.bearing_clearance(study.design, sampled.bearing_clearance)
    drive = drive_of(study, CRANK_DEG, compliance, assembly.errors(sampled), clearance)
    cycle = assembly.load_cycle(study, 0)
    solve_cycle(drive, cycle)  # finds the gaps, which are not timed
    return 1e6 / UNITS * seconds_of(partial(solve_cycle, drive, cycle))
