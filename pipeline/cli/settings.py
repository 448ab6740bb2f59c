"""What the commands share: where things lie, and what a run may use."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.config import Study
from pipeline.engine.processes.cluster import dask_cluster
from pipeline.engine.runner import Resources
from pipeline.errors import InputError

ROOT = Path(__file__).parent.parent.parent
RUNS = ROOT / "data" / "runs"
PUBLISHED = ROOT / "data" / "published"
ALL_WORKERS = -1
"""Joblib's number of processes for as many as the cluster has."""


@contextmanager
def resources(study: Study, options: argparse.Namespace) -> Iterator[Resources]:
    """Where and with how many processes chunks are solved; a cluster is connected while the context lasts."""
    if options.jobs is not None and options.jobs < 1:
        raise InputError(f"--jobs = {options.jobs}; must be at least 1")
    if (options.backend == "dask") != (options.scheduler is not None):
        raise InputError("--backend dask and --scheduler ADDRESS go together; give both or neither")
    if options.backend == "dask":
        with dask_cluster(options.scheduler, options.open_scheduler) as cluster:
            yield Resources(options.jobs or ALL_WORKERS, study.run.chunk, cluster)
    else:
        yield Resources(options.jobs or study.run.jobs, study.run.chunk)


def check_sample(study: Study, sample: int) -> None:
    """Raise InputError if the study has no such sample."""
    if not 0 <= sample < study.samples.rows:
        raise InputError(f"--sample = {sample}; study {study.name} has samples 0 to {study.samples.rows - 1}")


def shown(path: Path) -> Path:
    """A path as short as it can be typed from here."""
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path
