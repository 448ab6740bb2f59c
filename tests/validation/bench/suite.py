"""The whole bench: rates, ratios and the stages at growing numbers of samples, in processor time."""

import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from threadpoolctl import threadpool_limits

from pipeline.config import Study
from pipeline.config.studies.study import FEWEST_BASE_SAMPLES
from pipeline.engine.cache import Cache
from pipeline.engine.runner import Resources, run
from pipeline.engine.stage import Job
from pipeline.engine.store import Output
from stages import hysteresis
from stages.chain import STAGES
from tests.validation.bench.growth import growth
from tests.validation.bench.launch import launching
from tests.validation.bench.preload import preload
from tests.validation.bench.rates import hot_parts
from tests.validation.bench.rivals import calculix, condensing
from tests.validation.bench.table import STAGE, Result

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
