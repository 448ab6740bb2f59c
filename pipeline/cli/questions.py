"""Commands that ask: two runs, costs and worst cases; lots and parts; states of a drive and populations."""

import argparse
from functools import partial

import pandas as pd

from pipeline import settings
from pipeline.cli.arguments import print_answer, workers
from pipeline.decisions.fresh_units import fresh_yields
from pipeline.decisions.reweighting import moved_tolerances, reweighted_yields
from pipeline.engine.store import write_atomic
from pipeline.errors import InputError
from pipeline.library.decisions import allocate, bounds, compare, compared_run, loaded_units
from pipeline.library.lots import MOST_LOTS, assemble, certificate, lots
from pipeline.library.measured import compared_states, population, series_of, shared_by_states, states_of
from pipeline.library.running import prepared_loops, study_of, up_to_date


def compare_runs(options: argparse.Namespace) -> None:
    """Compare two studies: run what is missing of both, then write the differences."""
    print_answer(compare(options.a, options.b, workers(options)))


def allocate_tolerances(options: argparse.Namespace) -> None:
    """Find the cheapest tolerances of a study at a wanted yield."""
    print_answer(allocate(options.study, options.target, options.units, workers(options)))


def bound_metrics(options: argparse.Namespace) -> None:
    """Bound the metrics of a study over its tolerance box, beside linear stacks and capability."""
    print_answer(bounds(options.study, workers(options)))


def reweigh_run(options: argparse.Namespace) -> None:
    """Yield of a study from the run of a wider one, beside that of fresh load-solved units."""
    if options.check < 1:
        raise InputError(f"--check = {options.check}; must be at least 1")
    wide, narrow = (study_of(name) for name in (options.wide, options.narrow))
    moved_tolerances(wide, narrow)  # says what is in the way before anything is run
    answer = reweighted_yields(compared_run(wide, workers(options)), narrow)
    upstream_run = up_to_date(narrow, ["springs", "reduce"], workers(options))
    loop_inputs = prepared_loops(narrow, upstream_run.outputs)
    fresh = fresh_yields(
        narrow, wide.samples.count, options.check, partial(loaded_units, loop_inputs), upstream_run.jobs
    )
    kinds = {"reweighted": answer.yields, "fresh": fresh}
    rows = pd.DataFrame(
        [{"metric": name, "units": kind, **vars(shares[name])} for name in fresh for kind, shares in kinds.items()]
    )
    table = settings.RUNS / "reweigh" / f"{wide.name}-{narrow.name}.csv"
    write_atomic(table, rows.to_csv(index=False, float_format="%.9g").encode())
    for name, share in answer.keeps.items():
        print(f"{name}: its weights alone are worth {100 * share:.3g} % of the units")
    print(f"{answer.units:,} units of {wide.name} are worth {answer.effective:,.0f} of {narrow.name}")
    print(rows.to_string(index=False, float_format=lambda value: f"{value:.4f}"))
    print(f"table: {settings.shown(table)}")


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
    print_answer(population(options.units, options.study, options.over, workers(options), options.noise))
