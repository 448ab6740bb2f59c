"""Ratios to other ways: CalculiX on the same mesh and contacts, and condensing the disk without its symmetry."""

import csv
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from pipeline import assembly, elastic
from pipeline.checks.specimen import SHARES, Specimen
from pipeline.config import Study
from pipeline.model.load_history.load_cycle import solve_cycle
from pipeline.mounting import drive_of
from pipeline.sampling.errors import draw
from tests.validation.bench.rates import seconds_of
from tests.validation.bench.table import Result

COPIES = 500
"""Times that one sample is solved, as many as a chunk of a study has samples."""
ANGLES_BY_SECTOR, ANGLES_WHOLE = 31, 4
"""Crank angles condensed by the disk's sectors, and on the whole disk."""
VERIFIED = "5 loads, CalculiX: time [s]"
"""Row of the results of `verify`."""


def condensing(study: Study) -> Iterator[Result]:
    """Time of condensing many crank angles by the disk's sectors, over that of a few on the factorised whole disk.

    Each way meshes the disk anew. Nothing where holes leave the disk no symmetry.
    """
    if elastic.elastic_disk(study).sectors == 1:
        return
    by_sector, by_disk = _condensing_seconds(study, ANGLES_BY_SECTOR), _condensing_seconds(study, ANGLES_WHOLE, 1)
    note = (
        f"{ANGLES_BY_SECTOR} crank angles in {by_sector:.2f} s over {ANGLES_WHOLE} on the whole disk in {by_disk:.2f} s"
    )
    yield Result("condensing_ratio", by_sector / by_disk, "1", 1, 1, note)


def _condensing_seconds(study: Study, angles: int, sectors: int | None = None) -> float:
    """Processor time [s] of so many crank angles evenly over a turn; ``sectors`` replaces the disk's own number."""
    start = time.process_time()
    disk = elastic.elastic_disk(study)
    disk = disk if sectors is None else replace(disk, sectors=sectors)
    for crank in np.arange(angles) * 360 / angles:
        disk.compliance(elastic.disk_patches(study, disk, assembly.reducer(study.design, crank)))
    return time.process_time() - start


def calculix(study: Study, verified: Path) -> Iterator[Result]:
    """Time of CalculiX per load step in the last `make verify` over ours on the mesh of ``study``; nothing without one.

    Ours is a batch of copies of one sample through the study's cycle, each distinct load counted once; CalculiX solves
    five loads.
    """
    if not verified.exists():
        return
    with verified.open(newline="") as file:
        times = [float(row["computed"]) for row in csv.DictReader(file) if row["quantity"] == VERIFIED]
    if not times:
        return
    specimen = Specimen(study).in_stress("plane_strain")
    cycle = assembly.load_cycle(study, study.cycle.levels_per_branch)
    errors = assembly.errors(draw(specimen.study, specimen.sample, specimen.sample + 1))
    clearance = np.array([specimen.bearing_clearance])
    drive = drive_of(specimen.study, specimen.crank_deg, specimen.compliance, errors, clearance, specimen.laws)
    copies = drive.some(np.zeros(COPIES, int))
    seconds = seconds_of(partial(solve_cycle, copies, cycle)) / (COPIES * 2 * len(cycle.fractions))
    for run_time in times:
        rival_seconds = run_time / len(SHARES)
        note = f"{rival_seconds:.3g} s over {1e6 * seconds:.3g} us a load step"
        yield Result("calculix_ratio", rival_seconds / seconds, "1", COPIES, 1, note)
