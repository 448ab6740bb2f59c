"""The whole bench: rates, ratios and the stages at growing numbers of samples, in processor time."""

import os
import resource
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from threadpoolctl import threadpool_limits

from pipeline import assembly
from pipeline.config import Design, Study
from pipeline.config.studies.study import FEWEST_BASE_SAMPLES
from pipeline.engine.cache import Cache
from pipeline.engine.runner import Resources, run
from pipeline.engine.stage import Job
from pipeline.engine.store import Output
from pipeline.library.running import COMPILES_SOLVER
from pipeline.model.load_history.load_cycle import solve_cycle
from pipeline.mounting import drive_of
from pipeline.sampling.errors import draw
from stages import hysteresis
from stages.chain import STAGES
from tests.validation.bench.rates import calculix, condensing, hot_parts, preload, seconds_of
from tests.validation.bench.table import STAGE, Result

COMMANDS = (("--version",), ("keys", "loaded_angles"), ("why", "report"))
"""Commands that compute nothing."""


def child_seconds(command: Sequence[str], environment: Mapping[str, str] | None = None) -> float:
    """Processor time [s] of a process and its children."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, env=environment, capture_output=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def launching(study: Study) -> Iterator[Result]:
    """Start of commands that compute nothing, and compiling the solver where nothing is compiled."""
    for command in COMMANDS:
        of_study = ("--study", study.name) if command[0] == "why" else ()
        seconds = child_seconds([sys.executable, "-m", "pipeline", *command, *of_study])
        yield Result("startup_seconds", seconds, "s", 0, 1, " ".join(("pipeline", *command, *of_study)))
    with TemporaryDirectory() as folder:
        seconds = child_seconds(
            [sys.executable, "-c", COMPILES_SOLVER, str(os.getpid())], os.environ | {"NUMBA_CACHE_DIR": folder}
        )
    yield Result("compile_seconds", seconds, "s", 0, 1, "solver and its start from an interior point, once per version")


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
    study = study.with_section("samples", count=UNITS).model_copy(update={"design": design})
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


SAMPLES = (100, 1_000)
"""Sizes of the study that are timed: a decade apart, so that growth shows."""


def bench(study: Study, coarse: Study, several_disks: Study, runs: Path) -> Iterator[Result]:
    """Measure a study at growing numbers of samples, each stage in processor time of one process.

    Parameters
    ----------
    coarse : study whose mesh CalculiX solves, which takes minutes at the paper's size.
    several_disks : study of a reducer with more than one disk.
    runs : folder of the runs; the bench's own are made in it and deleted, and condense anew.
    """
    _announce("start of commands, compilation")
    yield from launching(study)
    with TemporaryDirectory(dir=runs, prefix="bench-") as name, threadpool_limits(1):
        folder = Path(name)
        previous: dict[str, float] = {}
        for samples in SAMPLES:
            sized = _sized(study, samples)
            seconds: dict[str, float] = {}
            outputs: dict[str, Output] = {}
            for stage in STAGES:
                _announce(f"{samples:,} samples, stage {stage.name}")
                start = time.process_time()
                outputs = run(STAGES, sized, [stage.name], folder, Resources(1, study.run.chunk)) | outputs
                seconds[stage.name] = time.process_time() - start
            yield from _stages(sized, seconds, outputs, previous)
            previous = seconds
            if samples == SAMPLES[0]:
                _announce("rates of the hot parts")
                shared = hysteresis.prepare(Job(sized, 1, folder, outputs, Cache(folder / ".cache", "")))
                yield from hot_parts(sized, shared, samples)
                yield from preload(sized, shared)
        _announce("growth with pins and disks")
        yield from growth(study, several_disks)
        _announce("condensing")
        yield from condensing(study)
        _announce("CalculiX, if make verify has run it")
        yield from calculix(coarse, runs / "verify" / "results.csv")


def _announce(part: str) -> None:
    print(f"bench: {part}", file=sys.stderr, flush=True)


def _sized(study: Study, samples: int) -> Study:
    """The study with so many samples, drivers in proportion, and no other forms of the model."""
    base = round(study.drivers.base_samples * samples / study.samples.count)
    drivers = study.drivers.model_copy(update={"base_samples": max(base, FEWEST_BASE_SAMPLES) if base else 0})
    sizes = {"name": str(samples), "samples": study.samples.model_copy(update={"count": samples})}
    return study.model_copy(update={**sizes, "drivers": drivers, "model_forms": None})


def _stages(
    study: Study, seconds: Mapping[str, float], outputs: Mapping[str, Output], previous: Mapping[str, float]
) -> Iterator[Result]:
    """Processor time of every stage, of the study and of a pair of the search, growth, and the peak of memory."""
    samples = study.samples.count
    for name, value in seconds.items():
        grown = f"{value / previous[name]:.2g} times those of a tenth" if previous else "the first: condenses anew"
        yield Result(f"{STAGE}{name}", value, "s", samples, 1, grown)
    note = f"{study.name} samples, {study.drivers.base_samples} base samples of drivers, no other forms of the model"
    yield Result("study_seconds", sum(seconds.values()), "s", samples, 1, note)
    if study.cycle.has_turn_search:
        pairs = sum(int(np.sum(outputs["worst"].read(table)["n_solved"])) for table in ("found", "audit"))
        note = f"{pairs:,} pairs of a unit and an angle, ranking included"
        yield Result("searched_pair_microseconds", 1e6 * seconds["worst"] / pairs, "us", samples, 1, note)
    peak = max(output.record["peak_memory_bytes"] for output in outputs.values())
    yield Result("peak_memory_gib", peak / 2**30, "GiB", samples, 1)
