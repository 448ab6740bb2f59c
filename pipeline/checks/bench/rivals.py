"""Ratios to other ways: CalculiX on the same mesh and contacts, and the bare solves of a condensation."""

import csv
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from pipeline import assembly, elastic
from pipeline.checks.bench.rates import seconds_of
from pipeline.checks.bench.table import Result
from pipeline.checks.calculix import THREADS, calculix_deck, calculix_program, run_calculix
from pipeline.checks.specimen import SHARES, Specimen, loaded
from pipeline.config import Study
from pipeline.model.elastic.condensed_body import COLUMNS_AT_ONCE
from pipeline.model.load_history.load_cycle import solve_cycle

COPIES = 500
"""Times that one sample is solved, as many as a chunk of a study has samples."""
VERIFIED = "5 loads, CalculiX: time [s]"
"""Row of the results of `verify`."""


def condensing(study: Study) -> Iterator[Result]:
    """Cost of one more crank angle on the factorised disk, over that of its right-hand sides."""
    disk = elastic.elastic_disk(study)
    at = assembly.reducer(study.design, study.cycle.crank_deg[-1])
    patches = elastic.disk_patches(study, disk, at)
    loads = disk.loads(patches)[:, :COLUMNS_AT_ONCE].toarray(order="F")
    bare = seconds_of(partial(disk.solve, loads)) * len(patches) / COLUMNS_AT_ONCE
    whole = seconds_of(lambda: disk.compliance(elastic.disk_patches(study, disk, at)))
    note = f"one more crank angle, {len(patches)} right-hand sides of {disk.freedoms.size} freedoms in {bare:.2f} s"
    yield Result("condensing_ratio", whole / bare, "1", 1, 1, note)


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
    ours = loaded(specimen, torque)
    gap, loose = np.tile(specimen.gap, (COPIES, 1)), np.full(COPIES, specimen.bearing_clearance)
    bodies = (specimen.reducer, specimen.bearing, specimen.laws, specimen.compliance)
    seconds = seconds_of(partial(solve_cycle, *bodies, gap, loose, cycle)) / (COPIES * 2 * len(cycle.fractions))
    with tempfile.TemporaryDirectory() as folder:
        answer = run_calculix(calculix_deck(specimen, torque, ours), Path(folder))
    theirs = answer.seconds / len(torque)
    freedoms = specimen.disk.freedoms.size
    note = f"{theirs:.3g} s on {THREADS} threads over {1e6 * seconds:.3g} us a load step, {freedoms} freedoms"
    yield Result("calculix_ratio", theirs / seconds, "1", COPIES, 1, note)
    if verified.exists():
        with verified.open(newline="") as file:
            times = [float(row["computed"]) for row in csv.DictReader(file) if row["quantity"] == VERIFIED]
        for one in times:
            theirs = one / len(torque)
            note = f"{theirs:.3g} s of the last make verify, which the size of the mesh does not change in ours"
            yield Result("calculix_ratio", theirs / seconds, "1", COPIES, 1, note)
