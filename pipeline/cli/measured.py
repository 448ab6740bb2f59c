"""Commands on measured units: what states share, what changed between two, whether many differ from a study."""

import argparse

from pipeline.cli.arguments import workers
from pipeline.cli.printing import print_answer
from pipeline.library.measured import compared_states, population, series_of, shared_by_states, states_of


def identify_series(options: argparse.Namespace) -> None:
    """Say what several states of one drive share, and how each differs."""
    measurements = series_of(options.series)
    print("\n".join(line for measurement in measurements for line in measurement.summary), flush=True)
    print_answer(shared_by_states(measurements, options.series, options.over))


def compare_states(options: argparse.Namespace) -> None:
    """Say what changed between two measurements of one drive."""
    states = states_of(options.before, options.after, options.also)
    print("\n".join(line for state in states for line in state.summary), flush=True)
    print_answer(compared_states(states))


def compare_population(options: argparse.Namespace) -> None:
    """Compare measured units with the distributions of a study."""
    print_answer(population(options.units, options.study, options.over, workers(options)))
