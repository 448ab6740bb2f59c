"""Ratios to other ways: CalculiX on the same mesh and contacts, and condensing the disk without its symmetry."""

import csv
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from pipeline import assembly, elastic
from pipeline.checks.calculix import THREADS, calculix_deck, calculix_program, run_calculix
from pipeline.checks.specimen import SHARES, Specimen, loaded
from pipeline.config import Study
from pipeline.model.load_history.load_cycle import solve_cycle
from pipeline.mounting import drive_of
from pipeline.sampling import draw
from tests.validation.bench.rates import REPEATS, seconds_of
from tests.validation.bench.table import Result

COPIES = 500
"""Times that one sample is solved, as many as a chunk of a study has samples."""
ANGLES_BY_SECTOR, ANGLES_WHOLE = 31, 4
"""Crank angles condensed by the disk's sectors, and on the whole disk."""
VERIFIED = "5 loads, CalculiX: time [s]"
"""Row of the results of `verify`."""


def condensing(study: Study) -> Iterator[Result]:
    """Time of condensing many crank angles by the disk's sectors, over that of a few on the factorised whole disk.

    Each way meshes the disk anew; they take turns. Nothing where holes leave the disk no symmetry.
    """
    if elastic.elastic_disk(study).sectors == 1:
        return
    times = np.array(
        [
            [_condensing_seconds(study, ANGLES_BY_SECTOR), _condensing_seconds(study, ANGLES_WHOLE, 1)]
            for _ in range(REPEATS)
        ]
    )
    by_sector, by_disk = np.median(times, axis=0)
    note = (
        f"{ANGLES_BY_SECTOR} crank angles in {by_sector:.2f} s over {ANGLES_WHOLE} on the whole disk in {by_disk:.2f} s"
    )
    yield Result("condensing_ratio", float(np.median(times[:, 0] / times[:, 1])), "1", 1, 1, note)


def _condensing_seconds(study: Study, angles: int, sectors: int | None = None) -> float:
    """Processor time [s] of so many crank angles evenly over a turn; ``sectors`` replaces the disk's own number."""
    start = time.process_time()
    disk = elastic.elastic_disk(study)
    disk = disk if sectors is None else replace(disk, sectors=sectors)
    for crank in np.arange(angles) * 360 / angles:
        disk.compliance(elastic.disk_patches(study, disk, assembly.reducer(study.design, crank)))
    return time.process_time() - start


def calculix(study: Study, verified: Path) -> Iterator[Result]:
    """Time of CalculiX per load step over ours, on the mesh of ``study`` and, where `verify` ran, on that one's too.

    Ours is a batch of copies of the sample through the study's cycle, each distinct load counted once; CalculiX solves
    five loads. Nothing where it is not installed.
    """
    if calculix_program() is None:
        return
    specimen = Specimen(study).in_stress("plane_strain")
    cycle = assembly.load_cycle(study, study.cycle.levels_per_branch)
    torque = SHARES * specimen.rated_torque
    solution = loaded(specimen, torque)
    errors = assembly.errors(draw(specimen.study, specimen.sample, specimen.sample + 1))
    clearance = np.array([specimen.bearing_clearance])
    drive = drive_of(specimen.study, specimen.crank_deg, specimen.compliance, errors, clearance, specimen.laws)
    copies = drive.some(np.zeros(COPIES, int))
    seconds = seconds_of(partial(solve_cycle, copies, cycle)) / (COPIES * 2 * len(cycle.fractions))
    with tempfile.TemporaryDirectory() as folder:
        answer = run_calculix(calculix_deck(specimen, torque, solution), Path(folder))
    rival_seconds = answer.seconds / len(torque)
    freedoms = specimen.disk.freedoms.size
    note = f"{rival_seconds:.3g} s on {THREADS} threads over {1e6 * seconds:.3g} us a load step, {freedoms} freedoms"
    yield Result("calculix_ratio", rival_seconds / seconds, "1", COPIES, 1, note)
    if verified.exists():
        with verified.open(newline="") as file:
            times = [float(row["computed"]) for row in csv.DictReader(file) if row["quantity"] == VERIFIED]
        for run_time in times:
            rival_seconds = run_time / len(torque)
            note = f"{rival_seconds:.3g} s of the last make verify, which the size of the mesh does not change in ours"
            yield Result("calculix_ratio", rival_seconds / seconds, "1", COPIES, 1, note)
