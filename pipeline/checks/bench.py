"""Speed of the study's hot parts: rates per core, and the ratio to the least that dense algebra would cost.

Every ratio is formed within one run, on one thread, because machines differ.
"""

import csv
import time
from collections.abc import Callable
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from pipeline import assembly
from pipeline.config import Study
from pipeline.engine.stage import Job
from pipeline.engine.store import Cache, Output
from pipeline.model.backlash import rigid_play
from pipeline.model.clearance import gaps
from pipeline.model.equilibrium import Equilibria
from pipeline.sampling import draw
from stages import hysteresis

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
    """Measure the hot parts on the samples of one chunk of a finished run.

    Parameters
    ----------
    outputs : finished stages of the study, up to the report.
    runs : folder of the runs; the table goes to ``bench/bench.csv`` in it.
    """
    n = min(study.run.chunk, study.samples.rows)
    sampled = draw(study, 0, n)
    errors, profile = assembly.errors(sampled), assembly.profile(study.design)
    shared = hysteresis.prepare(Job(study, 1, runs, outputs, Cache(runs / ".cache", "")))
    gap_um = outputs["clearance"].read_items("gaps", 0, n)["clearance_um"].reshape(n, len(shared.reducers), -1)
    loose = assembly.bearing_clearance(study.design, sampled.bearing_clearance)
    results = []
    with threadpool_limits(1):
        solved = hysteresis.solve_samples(shared, gap_um, sampled.bearing_clearance)  # compiles
        loops = n * len(shared.reducers)
        seconds = _seconds(lambda: hysteresis.solve_samples(shared, gap_um, sampled.bearing_clearance))
        floor, size = _floor_seconds(solved, len(shared.reducers[0].motions))
        steps = len(shared.cycle.steps[1])
        results.append(Result("loops_per_second_per_core", loops / seconds, "1/s", n, 1, f"{steps} steps a loop"))
        results.append(Result("floor_ratio", seconds / floor, "1", n, 1, f"mean system of {size:.1f} unknowns"))
        at = shared.reducers[0]

        def unloaded(method: str) -> float:
            options = {**dict(study.clearance), "method": method}
            return _seconds(lambda: rigid_play(at, gaps(profile, at, errors, **options), loose))

        for method in ("first_order", "exact"):
            rate = n / unloaded(method)
            results.append(Result("unloaded_per_second_per_core", rate, "1/s", n, 1, method))
    rows, jobs = study.samples.rows, outputs["hysteresis"].record["jobs"]
    stage_seconds = {name: output.record["seconds"] for name, output in outputs.items()}
    results.append(Result("study_seconds", sum(stage_seconds.values()), "s", rows, jobs, study.name))
    results += [Result(f"stage_seconds_{name}", value, "s", rows, jobs, "") for name, value in stage_seconds.items()]
    peak = max(output.record["peak_memory_bytes"] for output in outputs.values()) / 2**30
    results.append(Result("peak_memory_gib", peak, "GiB", rows, jobs, "all processes together"))
    return results


def write(results: list[Result], path: Path) -> None:
    """Write the table as CSV."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([field.name for field in fields(Result)])
        writer.writerows(astuple(result) for result in results)
