"""The whole bench: rates, ratios and the stages at growing numbers of samples."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from threadpoolctl import threadpool_limits

from pipeline.config import Study
from pipeline.engine.cache import Cache
from pipeline.engine.runner import Resources, run
from pipeline.engine.stage import Job
from pipeline.engine.store import Output
from stages import hysteresis
from stages.chain import STAGES
from stages.drivers import DRIVERS
from tests.validation.bench.preload import preload
from tests.validation.bench.rates import hot_parts
from tests.validation.bench.rivals import calculix, condensing
from tests.validation.bench.table import STAGE, Result

SAMPLES = (100, 1_000, 10_000)
"""Sizes of the study that are timed: a decade apart, so that growth shows."""
JOBS = 2
"""Processes of a timed run: the cores of the machine that the project is made for."""
LAST = STAGES[-1].name


def bench(study: Study, coarse: Study, runs: Path) -> Iterator[Result]:
    """Measure a study at growing numbers of samples.

    Parameters
    ----------
    coarse : study whose mesh CalculiX solves, which takes minutes at the paper's size.
    runs : folder of the runs; the bench's own are made in it and deleted, and condense anew.
    """
    with TemporaryDirectory(dir=runs, prefix="bench-") as name:
        folder, previous = Path(name), None
        cold = _seconds(_outputs(study, 1, 1, "hysteresis", folder))  # condenses the disk and compiles the solver
        yield Result(
            f"{STAGE}reduce", cold["reduce"], "s", 1, 1, f"condensed anew: {len(study.cycle.crank_deg)} cranks"
        )
        for samples in SAMPLES:
            outputs = _outputs(study, samples, JOBS, LAST, folder)
            with threadpool_limits(1):
                shared = hysteresis.prepare(Job(study, 1, folder, outputs, Cache(folder / ".cache", "")))
                hysteresis_alone = _outputs(study, samples, 1, "hysteresis", folder)
                yield from hot_parts(study, shared, samples)
                if samples == SAMPLES[0]:
                    yield from preload(study, shared)
            yield from _stages(study, outputs, samples)
            seconds = _seconds(outputs)["hysteresis"]
            yield Result("speedup_2_jobs", _seconds(hysteresis_alone)["hysteresis"] / seconds, "1", samples, JOBS)
            if previous is not None:
                note = f"seconds of hysteresis over those of {samples // 10:,} samples"
                yield Result("growth_10x", seconds / previous, "1", samples, JOBS, note)
            previous = seconds
    with threadpool_limits(1):
        yield from condensing(study)
        yield from calculix(coarse, runs / "verify" / "results.csv")


def _outputs(study: Study, samples: int, jobs: int, target: str, folder: Path) -> dict[str, Output]:
    """Outputs of a run of its own."""
    sized = study.samples.model_copy(update={"count": samples})
    sized_study = study.model_copy(update={"name": f"{samples}-{jobs}", "samples": sized})
    return run(STAGES, sized_study, [target], folder, Resources(jobs, study.run.chunk))


def _seconds(outputs: Mapping[str, Output]) -> dict[str, float]:
    return {name: output.record["seconds"] for name, output in outputs.items()}


def _stages(study: Study, outputs: Mapping[str, Output], samples: int) -> Iterator[Result]:
    """Seconds of every stage and the peak memory of the run."""
    seconds = _seconds(outputs)
    samples_alone = sum(value for name, value in seconds.items() if name != DRIVERS.name)
    note = f"{study.name}, disk from the cache; the extra units of drivers counted apart"
    yield Result("study_seconds", samples_alone, "s", samples, JOBS, note)
    for name, value in seconds.items():
        yield Result(f"{STAGE}{name}", value, "s", samples, JOBS)
    peak = max(output.record["peak_memory_bytes"] for output in outputs.values())
    yield Result("peak_memory_gib", peak / 2**30, "GiB", samples, JOBS, "all processes together")
