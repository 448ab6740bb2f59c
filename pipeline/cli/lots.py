"""Commands on measured parts: the yield of lots, which parts go together, and the certificate of one unit."""

import argparse

from pipeline.cli.arguments import workers
from pipeline.cli.printing import print_answer
from pipeline.errors import InputError
from pipeline.library.lots import MOST_LOTS, assemble, certificate, lots


def judge_lots(options: argparse.Namespace) -> None:
    """Fit the distributions of measured lots and solve the yield of a study made from them."""
    print_answer(lots(options.csv, options.study, options.units, workers(options)))


def assemble_parts(options: argparse.Namespace) -> None:
    """Assign the measured parts of one lot to those of another so that most units meet every limit."""
    if len(options.csv) != MOST_LOTS:
        raise InputError(f"--csv given {len(options.csv)} times; give it twice: the lots whose parts go together")
    first_csv, second_csv = options.csv
    print_answer(assemble(first_csv, second_csv, options.study, options.mounting_force, workers(options)))


def certify_unit(options: argparse.Namespace) -> None:
    """Predict what one unit will do from its measured dimensions, with a compensation table."""
    print_answer(certificate(options.dimensions, options.study, options.unit, options.draws, workers(options)))
