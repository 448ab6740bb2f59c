"""Rates of the hot parts on one core, and the floor of the loaded one.

A time is the processor's, of this thread, and the best of several: other programs on the machine count little.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.linalg.lapack import dposv

from pipeline import assembly
from pipeline.arrays import Real
from pipeline.config import Study
from pipeline.model.equilibrium.solve import Equilibria
from pipeline.model.geometry.clearance import Errors, gaps
from pipeline.model.geometry.cycloid_profile import CycloidProfile
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.geometry.rigid_play.rigid_backlash import RigidPlay, rigid_play
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
    sized = study.model_copy(update={"samples": study.samples.model_copy(update={"count": samples})})
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
