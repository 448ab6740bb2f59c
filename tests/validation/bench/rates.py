"""Rates per core of the hot parts, preloaded units beside others, and the least that dense algebra would cost.

Rates of the hot parts on one core, and the floor of the loaded one.

A time is the processor's, of this thread, and the best of several: other programs on the machine count little.

Preloaded units: what their equilibria take over those of the same units with play.

Contacts that interfere are many at no load, where units with play have none: what slows them down shows in no other
rate of the bench.

Ratios to other ways: CalculiX on the same mesh and contacts, and condensing the disk without its symmetry.
"""

import csv
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.linalg.lapack import dposv

from pipeline import assembly, elastic
from pipeline.arrays import Real
from pipeline.checks.specimen import SHARES, Specimen
from pipeline.config import Study
from pipeline.model.equilibrium.solve import Equilibria
from pipeline.model.geometry.clearance import Errors, gaps
from pipeline.model.geometry.cycloid_profile import CycloidProfile
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.geometry.rigid_play.rigid_backlash import RigidPlay, rigid_play
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.load_cycle import solve_cycle
from pipeline.model.units import MM_PER_UM
from pipeline.mounting import drive_of
from pipeline.sampling.errors import Errors as SampledErrors
from pipeline.sampling.errors import draw
from stages import hysteresis
from tests.validation.bench.table import Result

REPEATS = 3
"""A time is the best of so many."""
SOLVES = 200
"""Dense solves that are timed together."""


def seconds_of(action: Callable[[], object]) -> float:
    """Least processor time [s]."""
    times = []
    for _ in range(REPEATS):
        start = time.process_time()
        action()
        times.append(time.process_time() - start)
    return min(times)


def hot_parts(study: Study, shared: hysteresis.Shared, samples: int) -> Iterator[Result]:
    """Rates on so many samples, solved chunk by chunk as a study does."""
    curves, brief = replace(shared, brief=shared.curve), replace(shared, curve=shared.brief)
    sized = study.with_section("samples", count=samples)
    full, short, unloaded = 0.0, 0.0, {"first_order": 0.0, "exact": 0.0}
    sizes: dict[str, list[np.ndarray]] = {"curves": [], "metrics only": []}
    cranks = study.cycle.crank_deg
    profile, reducer = assembly.profile(study.design), assembly.reducer(study.design, cranks[0])
    for start in range(0, samples, study.run.chunk):
        sampled = draw(sized, start, min(start + study.run.chunk, samples))
        errors, clearance = (
            assembly.errors(sampled),
            assembly.bearing_clearance(study.design, sampled.bearing_clearance),
        )
        for method in unloaded:
            action = partial(
                _unloaded, reducer, profile, errors, clearance, {**study.clearance.model_dump(), "method": method}
            )
            unloaded[method] += seconds_of(action)
        full += seconds_of(partial(_solved, curves, sampled))
        short += seconds_of(partial(_solved, brief, sampled))
        for kind, way in (("curves", curves), ("metrics only", brief)):
            sizes[kind].append(_sizes(_solved(way, sampled), len(reducer.motions)))
    loops = samples * len(cranks)
    steps, brief_steps = (len(cycle.steps[1]) for cycle in (shared.curve, shared.brief))
    yield Result("loops_per_second_per_core", loops / full, "1/s", samples, 1, f"{steps} steps a loop")
    yield Result("metrics_only_per_second_per_core", loops / short, "1/s", samples, 1, f"{brief_steps} steps a loop")
    for (kind, parts), spent in zip(sizes.items(), (full, short), strict=True):
        size = np.concatenate(parts)
        note = f"{kind}: over one dposv each of {size.size} equilibria, mean system of {size.mean():.1f} unknowns"
        yield Result("floor_ratio", spent / _floor_seconds(size), "1", samples, 1, note)
        note = f"{kind}: all overhead included"
        yield Result("equilibrium_microseconds", 1e6 * spent / size.size, "us", samples, 1, note)
    for method, spent in unloaded.items():
        yield Result("unloaded_per_second_per_core", samples / spent, "1/s", samples, 1, method)


def _unloaded(
    reducer: Reducer, profile: CycloidProfile, errors: Errors, clearance: Real, options: dict[str, str]
) -> RigidPlay:
    return rigid_play(reducer, gaps(profile, reducer, errors, **options), clearance)


def _solved(shared: hysteresis.Shared, sampled: SampledErrors) -> list[Equilibria]:
    """Equilibria at every crank angle, the gaps included."""
    return [cycle.response.equilibria for cycle in hysteresis.solve_samples(shared, sampled)]


def _sizes(solutions: list[Equilibria], motions: int) -> np.ndarray:
    """Unknowns of every distinct loaded equilibrium: active contacts and rigid motions."""
    loaded_contacts = np.concatenate([np.count_nonzero(states.force > 0, axis=2).ravel() for states in solutions])
    return loaded_contacts[loaded_contacts > 0] + motions


def _floor_seconds(sizes: np.ndarray) -> float:
    """Time of one dense LAPACK solve of each size, by Cholesky's factors: the cheapest call for the system."""
    generator = np.random.default_rng(0)
    seconds = 0.0
    for size, count in zip(*np.unique(sizes, return_counts=True), strict=True):
        factor = generator.normal(size=(size, size))
        matrix = np.asfortranarray(factor @ factor.T + size * np.eye(size))
        right = generator.normal(size=size)
        seconds += count * seconds_of(partial(_solves, matrix, right)) / SOLVES
    return seconds


def _solves(matrix: np.ndarray, right: np.ndarray) -> None:
    for _ in range(SOLVES):
        dposv(matrix, right)


UNITS = 100
"""Units that are solved, preloaded and with play."""
NARROWED = 5.0
"""What gaps are less than drawn [um], or more. Most units are so preloaded, by half of their contacts: the slowest."""


def preload(study: Study, shared: hysteresis.Shared) -> Iterator[Result]:
    """Time of preloaded units over that of the same units with play, for either loop of the first crank angle.

    Nothing without any.
    """
    crank = study.cycle.crank_deg[0]
    sampled = draw(study.with_section("samples", count=UNITS), 0, UNITS)
    clearance = assembly.bearing_clearance(study.design, sampled.bearing_clearance)
    drawn = drive_of(study, crank, shared.compliances[0], assembly.errors(sampled), clearance, shared.laws[0])
    tight, loose = with_preload_and_with_play(drawn)
    if not len(tight.gap):
        return
    for kind, cycle in (("curves", shared.curve), ("metrics only", shared.brief)):
        seconds = [seconds_of(partial(solve_cycle, drive, cycle)) for drive in (tight, loose)]
        lost = np.count_nonzero(~np.all(solve_cycle(tight, cycle).converged, axis=1))
        note = f"{kind}: {len(tight.gap)} units with gaps {NARROWED:g} um smaller over the same with as much more"
        yield Result("preload_ratio", seconds[0] / seconds[1], "1", len(tight.gap), 1, f"{note}, {lost} not solved")


def with_preload_and_with_play(drive: Drive) -> tuple[Drive, Drive]:
    """Those states of a drive that smaller gaps preload while larger ones leave them play, with either gaps."""
    added_gap = np.full(drive.gap.shape, MM_PER_UM * NARROWED)
    tight, loose = drive.with_added_gap(-added_gap), drive.with_added_gap(added_gap)
    preloaded, still_preloaded = (
        rigid_play(variant.reducer, variant.gap, variant.bearing_clearance).preloaded for variant in (tight, loose)
    )
    states = np.flatnonzero(preloaded & ~still_preloaded)
    return tight.some(states), loose.some(states)


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
