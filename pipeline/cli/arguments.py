"""What typed options mean to the library."""

import argparse

from pipeline.config import Study
from pipeline.errors import InputError
from pipeline.library.running import Workers


def workers(options: argparse.Namespace) -> Workers:
    """Who solves."""
    return Workers(options.jobs, options.backend, options.scheduler, options.open_scheduler)


def check_sample(study: Study, sample: int) -> None:
    """Raise InputError if the study has no such sample."""
    if not 0 <= sample < study.samples.rows:
        raise InputError(f"--sample = {sample}; study {study.name} has samples 0 to {study.samples.rows - 1}")
