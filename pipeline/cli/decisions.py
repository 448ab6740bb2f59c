"""Commands that help to decide: two runs side by side, what to loosen or tighten, and worst cases."""

import argparse
from functools import partial

import pandas as pd

from pipeline import settings
from pipeline.cli.arguments import workers
from pipeline.cli.printing import print_answer
from pipeline.decisions.fresh_units import fresh_yields
from pipeline.decisions.reweighting import moved_tolerances, reweighted_yields
from pipeline.engine.store import write_atomic
from pipeline.errors import InputError
from pipeline.library.decisions import allocate, bounds, compare, compared_run, loaded_units
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
