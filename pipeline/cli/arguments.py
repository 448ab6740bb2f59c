"""What typed options mean to the library, and what a command prints of its answer."""

import argparse
from typing import Any

from pipeline import settings
from pipeline.config import Study
from pipeline.errors import InputError
from pipeline.library.running import Answer, Workers


def workers(options: argparse.Namespace) -> Workers:
    """Who solves."""
    return Workers(options.jobs, options.backend, options.scheduler, options.open_scheduler)


def check_sample(study: Study, sample: int) -> None:
    """Raise InputError if the study has no such sample."""
    if not 0 <= sample < study.samples.rows:
        raise InputError(f"--sample = {sample}; study {study.name} has samples 0 to {study.samples.rows - 1}")


def print_answer(answer: Answer[Any]) -> None:
    """Its sentences, and where its page is."""
    print(answer)
    if answer.report is not None:
        label = "report" if answer.page == "report.html" else "page"
        print(f"{label}: {settings.shown(answer.report)}")
