"""Commands that help to decide: two runs side by side, what to loosen or tighten, and worst cases."""

import argparse
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd

from pipeline.cli import settings
from pipeline.cli.running import up_to_date
from pipeline.config import Study, load_study
from pipeline.config.files.writing import toml_of
from pipeline.decisions.allocation import results as allocation_results
from pipeline.decisions.allocation.allocate import allocate
from pipeline.decisions.allocation.priced import priced_tolerances
from pipeline.decisions.bounds import results as bounds_results
from pipeline.decisions.bounds.box import Box
from pipeline.decisions.fresh_units import Angles, fresh_yields
from pipeline.decisions.reweighting import moved_tolerances, reweighted
from pipeline.decisions.run_comparison import (
    ComparedRun,
    check_comparable,
    differences,
    differing_inputs,
    driver_changes,
)
from pipeline.engine.cache import Cache
from pipeline.engine.progress import Line, say
from pipeline.engine.stage import Job
from pipeline.engine.store import write_atomic
from pipeline.errors import InputError
from pipeline.model.metrics import library
from pipeline.population import prediction, tails
from pipeline.report.decisions.allocation import sentence as allocation_sentence
from pipeline.report.decisions.allocation import write_allocation_page
from pipeline.report.decisions.bounds import write_bounds_page
from pipeline.report.decisions.compare import answer_lines, write_comparison
from pipeline.sampling import Errors, draw
from stages import hysteresis
from stages.aggregate import over_turn
from stages.clearance import rigid_ends
from stages.tables.turn import loop_metrics, metric_turns, over_turn_columns
from stages.tails import TRIAL, at_angles, springs

FEWEST_BAD = 20
"""Units beyond a limit that a slope of the yield is told from."""
DESIGN_FILE = "design.toml"


def compare_runs(options: argparse.Namespace) -> None:
    """Compare two studies: run what is missing of both, then write the differences."""
    a, b = (_run(study, options) for study in _comparable_studies(options.a, options.b))
    rows = differences(a, b)
    folder = settings.RUNS / "compare" / f"{a.label}-{b.label}"
    write_comparison(a, b, differing_inputs(a.study, b.study), rows, driver_changes(a, b), folder)
    print("\n".join(answer_lines(a, b, pd.DataFrame(rows))))
    print(f"report: {settings.shown(folder / 'report.html')}")


def _comparable_studies(*names: str) -> list[Study]:
    """Two studies, both checked before anything runs."""
    studies: list[Study] = []
    problems: list[str] = []
    for name in names:
        try:
            studies.append(load_study(name, settings.ROOT))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    check_comparable(*studies)
    return studies


def _run(study: Study, options: argparse.Namespace) -> ComparedRun:
    outputs = up_to_date(study, ["aggregate"], options)
    units, sensitivity = (pd.DataFrame(outputs.outputs["aggregate"].read(name)) for name in ("units", "sensitivity"))
    return ComparedRun(outputs.study, _random_units(study, units), sensitivity)


def _random_units(study: Study, units: pd.DataFrame) -> pd.DataFrame:
    """The metrics of the units of a study over the turn, as its limits count them, without the nominal reducer."""
    return over_turn(units, study.limits.over).drop(index=[0] * study.samples.nominal_first, errors="ignore")


def allocate_tolerances(options: argparse.Namespace) -> None:
    """Find the cheapest tolerances of a study at a wanted yield."""
    if not 0.5 <= options.target < 1:
        raise InputError(f"--yield = {options.target:g}; must be from 0.5 to below 1, as 0.99")
    expected_failures = round(options.units * (1 - options.target), 6)
    if expected_failures < FEWEST_BAD:
        fewest_units = round(FEWEST_BAD / (1 - options.target))
        raise InputError(
            f"--units {options.units} is too small for a yield of {100 * options.target:g} %; "
            f"use at least {fewest_units}"
        )
    study = load_study(options.study, settings.ROOT)
    priced_tolerances(study)  # says what is missing before anything is condensed
    condensed = up_to_date(study, ["springs", "reduce"], options)
    shared = hysteresis.prepare(Job(study, 1, settings.RUNS, condensed.outputs, Cache(settings.RUNS / ".cache", "")))
    trial = draw(tails.population(study, TRIAL), 0, TRIAL)
    rough = partial(prediction.rough_metrics, study, springs(shared, trial))
    tell = partial(say, "allocate")
    allocation = allocate(
        study, options.target, options.units, partial(loaded_units, shared), rough, condensed.jobs, tell
    )
    folder = settings.RUNS / "allocate" / study.name
    allocation_results.write_tables(allocation, folder)
    file = f"{allocation_results.study_name(study)}.toml"
    write_atomic(folder / file, allocation_results.study_text(allocation, DESIGN_FILE).encode())
    write_atomic(folder / DESIGN_FILE, toml_of(study.design.model_dump()).encode())
    write_allocation_page(allocation, file, folder)
    print(allocation_sentence(allocation))
    print(f"study: {settings.shown(folder / file)}")
    print(f"report: {settings.shown(folder / 'report.html')}")


def reweigh_run(options: argparse.Namespace) -> None:
    """Yield of a study from the run of a wider one, beside that of fresh load-solved units."""
    if options.check < 1:
        raise InputError(f"--check = {options.check}; must be at least 1")
    wide, narrow = (load_study(name, settings.ROOT) for name in (options.wide, options.narrow))
    moved_tolerances(wide, narrow)  # says what is in the way before anything is run
    answer = reweighted(_run(wide, options), narrow)
    condensed = up_to_date(narrow, ["springs", "reduce"], options)
    shared = hysteresis.prepare(Job(narrow, 1, settings.RUNS, condensed.outputs, Cache(settings.RUNS / ".cache", "")))
    fresh = fresh_yields(narrow, wide.samples.count, options.check, partial(loaded_units, shared), condensed.jobs)
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


def loaded_units(shared: hysteresis.Shared, sampled: Errors) -> tuple[Angles, Angles]:
    """Every metric of ``n`` units at the loaded angles (n, n_angles), and over the turn as the limits mean it (n,)."""
    study = shared.study
    loops = hysteresis.solved_loops(replace(shared, curve=shared.brief), sampled)
    metrics, ends = loop_metrics(study, loops.columns), rigid_ends(study, sampled)
    turn_values = over_turn_columns(metric_turns(study, metrics, ends[:, 0] - ends[:, 1]))
    angles = {name: metrics[name].reshape(len(sampled), -1) for name in library()}
    return angles, {name: turn_values[f"{name}_{study.limits.over}"] for name in library()}


def bound_metrics(options: argparse.Namespace) -> None:
    """Bound the metrics of a study over its tolerance box, beside linear stacks and capability."""
    study = load_study(options.study, settings.ROOT)
    Box.of(study)  # says what is missing before anything is condensed
    run_outputs = up_to_date(study, ["aggregate"], options)
    study, outputs = run_outputs.study, run_outputs.outputs
    shared = hysteresis.prepare(Job(study, 1, settings.RUNS, outputs, Cache(settings.RUNS / ".cache", "")))
    units = _random_units(study, pd.DataFrame(outputs["aggregate"].read("units")))
    cranks = study.cycle.curve_crank_deg
    with Line("bounds", "metrics and angles", len(cranks) * len(bounds_results.all_bounded(study))) as line:
        solve = partial(_at_crank, shared)
        findings = bounds_results.findings(study, cranks, solve, units, partial(line.advance, 1, 0))
    folder = settings.RUNS / "bounds" / study.name
    bounds_results.write_tables(findings, folder)
    write_bounds_page(findings, folder)
    print((folder / "bounds.csv").read_text(), end="")
    print(f"report: {settings.shown(folder / 'report.html')}")


def _at_crank(shared: hysteresis.Shared, crank_deg: float, sampled: Errors) -> dict[str, np.ndarray]:
    """Every metric of ``n`` units at one loaded crank angle, (n,) each."""
    study, k = shared.study, shared.study.cycle.crank_deg.index(crank_deg)
    cycle = study.cycle.model_copy(update={"crank_deg": (crank_deg,), "loaded_angles": None})
    reduced_study = study.model_copy(update={"cycle": cycle})
    single = replace(
        shared, study=reduced_study, laws=shared.laws[k : k + 1], compliances=shared.compliances[k : k + 1]
    )
    return {name: values[:, 0] for name, values in at_angles(single, sampled).items()}
