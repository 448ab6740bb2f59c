"""Speed of the study's hot parts: rates per core, and the ratio to the least that dense algebra would cost.

Every ratio is formed within one run, on one thread, because machines differ.
"""

import csv
import time
from collections.abc import Callable
from dataclasses import astuple, dataclass, fields, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from threadpoolctl import threadpool_limits

from pipeline import assembly
from pipeline.config import Study
from pipeline.engine.runner import Resources, run
from pipeline.engine.stage import Job
from pipeline.engine.store import Cache, Output
from pipeline.model.backlash import RigidPlay, rigid_play
from pipeline.model.clearance import Errors, gaps
from pipeline.model.equilibrium import Equilibria
from pipeline.model.profile import CycloidProfile, Real
from pipeline.model.reducer import Reducer
from pipeline.sampling import draw
from stages import hysteresis
from stages.chain import STAGES

REPEATS = 3
"""A time is the best of so many, so that another program on the machine counts little."""


@dataclass(frozen=True)
class Result:
    """One row of ``bench.csv``."""

    name: str
    value: float
    unit: str
    samples: int
    jobs: int
    note: str


def _seconds(action: Callable[[], object]) -> float:
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return min(times)


def _floor_seconds(solved: list[Equilibria], motions: int) -> tuple[float, float]:
    """Time of one dense LAPACK solve per distinct loaded equilibrium, and the mean size of their systems."""
    sizes = np.concatenate([np.count_nonzero(states.force > 0, axis=2).ravel() for states in solved])
    sizes = sizes[sizes > 0] + motions
    generator = np.random.default_rng(0)
    seconds = 0.0
    for size, count in zip(*np.unique(sizes, return_counts=True), strict=True):
        matrix = generator.normal(size=(size, size)) + size * np.eye(size)
        right = generator.normal(size=size)
        seconds += count * _solve_seconds(matrix, right)
    return seconds, float(sizes.mean())


def _solve_seconds(matrix: np.ndarray, right: np.ndarray) -> float:
    repeats = 200
    return _seconds(lambda: [np.linalg.solve(matrix, right) for _ in range(repeats)]) / repeats


def bench(study: Study, outputs: dict[str, Output], runs: Path) -> list[Result]:
    """Measure the hot parts, the gain of a second process and the growth with the number of samples.

    Parameters
    ----------
    outputs : finished stages of the study, up to the report.
    runs : folder of the runs, which holds the condensed disk.
    """
    with threadpool_limits(1):
        results = _hot_parts(study, outputs, runs)
    results += _growth(study, runs)
    rows, jobs = study.samples.rows, outputs["hysteresis"].record["jobs"]
    seconds = {name: output.record["seconds"] for name, output in outputs.items()}
    results.append(Result("study_seconds", sum(seconds.values()), "s", rows, jobs, study.name))
    results += [Result(f"stage_seconds_{name}", value, "s", rows, jobs, "") for name, value in seconds.items()]
    peak = max(output.record["peak_memory_bytes"] for output in outputs.values()) / 2**30
    results.append(Result("peak_memory_gib", peak, "GiB", rows, jobs, "all processes together"))
    return results


def _hot_parts(study: Study, outputs: dict[str, Output], runs: Path) -> list[Result]:
    """Rates per core on the samples of one chunk of the finished run, and the ratio to the floor."""
    n = min(study.run.chunk, study.samples.rows)
    sampled = draw(study, 0, n)
    errors, profile = assembly.errors(sampled), assembly.profile(study.design)
    shared = hysteresis.prepare(Job(study, 1, runs, outputs, Cache(runs / ".cache", "")))
    brief = replace(shared, cycle=assembly.load_cycle(with_levels(study, 0)))
    gap_um = outputs["clearance"].read_items("gaps", 0, n)["clearance_um"].reshape(n, len(shared.reducers), -1)
    loose, at = assembly.bearing_clearance(study.design, sampled.bearing_clearance), shared.reducers[0]
    solved = hysteresis.solve_samples(shared, gap_um, sampled.bearing_clearance)  # compiles
    loops = n * len(shared.reducers)
    full = _seconds(lambda: hysteresis.solve_samples(shared, gap_um, sampled.bearing_clearance))
    short = _seconds(lambda: hysteresis.solve_samples(brief, gap_um, sampled.bearing_clearance))
    floor, size = _floor_seconds(solved, len(at.motions))
    steps, few = (len(one.cycle.steps[1]) for one in (shared, brief))
    results = [
        Result("loops_per_second_per_core", loops / full, "1/s", n, 1, f"{steps} steps a loop"),
        Result("metrics_only_per_second_per_core", loops / short, "1/s", n, 1, f"{few} steps a loop"),
        Result("floor_ratio", full / floor, "1", n, 1, f"mean system of {size:.1f} unknowns"),
    ]
    for method in ("first_order", "exact"):
        options = {**dict(study.clearance), "method": method}
        unloaded = _seconds(partial(_unloaded, at, profile, errors, loose, options))
        results.append(Result("unloaded_per_second_per_core", n / unloaded, "1/s", n, 1, method))
    return results


def _unloaded(at: Reducer, profile: CycloidProfile, errors: Errors, loose: Real, options: dict[str, str]) -> RigidPlay:
    return rigid_play(at, gaps(profile, at, errors, **options), loose)


def with_levels(study: Study, levels: int) -> Study:
    """The study with another number of load levels a branch."""
    return study.model_copy(update={"cycle": study.cycle.model_copy(update={"levels_per_branch": levels})})


def _growth(study: Study, runs: Path) -> list[Result]:
    """Seconds of the stage hysteresis for 1,000 and 10,000 samples, and with one and two processes."""

    def hysteresis_seconds(samples: int, jobs: int, folder: Path) -> float:
        sized = study.samples.model_copy(update={"count": samples})
        named = study.model_copy(update={"name": f"{samples}-{jobs}", "samples": sized})
        outputs = run(STAGES, named, ["hysteresis"], folder, Resources(jobs, study.run.chunk))
        return outputs["hysteresis"].record["seconds"]

    with TemporaryDirectory(dir=runs, prefix="bench-") as folder:
        (Path(folder) / ".cache").symlink_to(runs / ".cache")
        few, many, alone = (
            hysteresis_seconds(samples, jobs, Path(folder)) for samples, jobs in ((1_000, 2), (10_000, 2), (10_000, 1))
        )
    return [
        Result("growth_10x", many / few, "1", 10_000, 2, "hysteresis, 10,000 samples over 1,000"),
        Result("speedup_2_jobs", alone / many, "1", 10_000, 2, "hysteresis"),
    ]


def write(results: list[Result], path: Path) -> None:
    """Write the table as CSV."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([field.name for field in fields(Result)])
        writer.writerows(astuple(result) for result in results)
