"""Questions that help to decide: two runs side by side, what to loosen or tighten, and worst cases."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import settings
from pipeline.config import Study
from pipeline.config.changing import toml_of
from pipeline.decisions import allocation as allocation_results
from pipeline.decisions import bounds as bounds_results
from pipeline.decisions.allocation import Allocation
from pipeline.decisions.allocation import allocate as cheapest_tolerances
from pipeline.decisions.box import Box
from pipeline.decisions.cheapest import priced_tolerances
from pipeline.decisions.fresh_units import PRELOADED, Angles
from pipeline.decisions.run_comparison import (
    ComparedRun,
    check_comparable,
    differences,
    differing_inputs,
    driver_changes,
)
from pipeline.engine.progress import Line, say
from pipeline.engine.store import write_atomic
from pipeline.errors import InputError
from pipeline.library.running import Answer, Workers, prepared_loops, study_of, up_to_date
from pipeline.model.metrics import library
from pipeline.populations import prediction, tails
from pipeline.report.decisions.bounds import sentence as allocation_sentence
from pipeline.report.decisions.bounds import write_allocation_page, write_bounds_page
from pipeline.report.decisions.compare import answer_lines, write_comparison
from pipeline.sampling.errors import Errors, draw
from stages import hysteresis
from stages.clearance import rigid_ends, rigid_turn
from stages.tables.distributions import over_turn
from stages.tables.turn import loop_metrics, metric_turns, over_turn_columns
from stages.tails import TRIAL, at_angles, springs

FEWEST_BAD = 20
"""Units beyond a limit that a slope of the yield is told from."""
DESIGN_FILE = "design.toml"


def compare(
    a: Study | str | Path, b: Study | str | Path, jobs: int | Workers | None = None
) -> Answer[tuple[ComparedRun, ComparedRun]]:
    """Two studies side by side: what differs, by how much; what is missing of both is run.

    Parameters
    ----------
    a, b : studies, or names or files of them; differences are b less a.
    jobs : processes; each study's own number if not given.

    Raises
    ------
    InputError
        If a file is wrong, or the two cannot be compared.
    """
    first_run, second_run = (compared_run(study, jobs) for study in _comparable_studies(a, b))
    rows = differences(first_run, second_run)
    folder = settings.RUNS / "compare" / f"{first_run.label}-{second_run.label}"
    inputs = differing_inputs(first_run.study, second_run.study)
    frames = write_comparison(first_run, second_run, inputs, rows, driver_changes(first_run, second_run), folder)
    return Answer(
        (first_run, second_run), tuple(answer_lines(first_run, second_run, pd.DataFrame(rows))), folder, frames
    )


def _comparable_studies(*names: Study | str | Path) -> list[Study]:
    """Two studies, both checked before anything runs."""
    studies: list[Study] = []
    problems: list[str] = []
    for name in names:
        try:
            studies.append(study_of(name))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    check_comparable(*studies)
    return studies


def compared_run(study: Study, jobs: int | Workers | None = None) -> ComparedRun:
    """The run of a study with its random units, as it is compared with another one."""
    finished_run = up_to_date(study, ["aggregate"], jobs)
    units, sensitivity = (
        pd.DataFrame(finished_run.outputs["aggregate"].read(name)) for name in ("units", "sensitivity")
    )
    return ComparedRun(finished_run.study, _random_units(study, units), sensitivity)


def _random_units(study: Study, units: pd.DataFrame) -> pd.DataFrame:
    """The metrics of the units of a study over the turn, as its limits count them, without the nominal reducer."""
    return over_turn(units, study.limits.over).drop(index=[0] * study.samples.nominal_first, errors="ignore")


def allocate(
    study: Study | str | Path, target: float = 0.99, units: int = 4_000, jobs: int | Workers | None = None
) -> Answer[Allocation]:
    """The cheapest tolerances of a study at a wanted yield.

    Parameters
    ----------
    study : with costs, or the name or file of one.
    target : yield against all limits.
    units : load-solved in each round.
    jobs : processes; the study's own number if not given.

    Raises
    ------
    InputError
        If the study has no costs or limits, or a number is wrong.
    """
    if not 0.5 <= target < 1:
        raise InputError(f"--yield = {target:g}; must be from 0.5 to below 1, as 0.99")
    if round(units * (1 - target), 6) < FEWEST_BAD:
        raise InputError(
            f"--units {units} is too small for a yield of {100 * target:g} %; "
            f"use at least {round(FEWEST_BAD / (1 - target))}"
        )
    study = study_of(study)
    priced_tolerances(study)  # says what is missing before anything is condensed
    upstream_run = up_to_date(study, ["springs", "reduce"], jobs)
    loop_inputs = prepared_loops(study, upstream_run.outputs)
    trial = draw(tails.population(study, TRIAL), 0, TRIAL)
    rough = partial(prediction.rough_metrics, study, springs(loop_inputs, trial))
    solve, tell = partial(loaded_units, loop_inputs), partial(say, "allocate")
    allocation = cheapest_tolerances(study, target, units, solve, rough, upstream_run.jobs, tell)
    folder = settings.RUNS / "allocate" / study.name
    frames = allocation_results.write(allocation, folder)
    file = f"{allocation_results.study_name(study)}.toml"
    write_atomic(folder / file, allocation_results.study_text(allocation, DESIGN_FILE).encode())
    write_atomic(folder / DESIGN_FILE, toml_of(study.design.model_dump()).encode())
    write_allocation_page(allocation, file, folder)
    sentences = allocation_sentence(allocation), f"study: {settings.shown(folder / file)}"
    return Answer(allocation, sentences, folder, frames)


def loaded_units(
    loop_inputs: hysteresis.Shared, sampled_errors: Errors, with_finite_motion: bool = False
) -> tuple[Angles, Angles]:
    """Every metric of ``n`` units at the loaded angles (n, n_angles), and over the turn as the limits mean it (n,).

    Over the turn with `PRELOADED`: whether the gaps of some part interfere at some crank angle.

    Parameters
    ----------
    with_finite_motion : whether the worst clearance backlash has what finite motions add, as that of a study; it takes
        longer than all else of rigid bodies.
    """
    study = loop_inputs.study
    loops = hysteresis.solved_loops(replace(loop_inputs, curve=loop_inputs.brief), sampled_errors)
    metrics, motion = loop_metrics(study, loops.columns), None
    if with_finite_motion:
        ends, motion = rigid_turn(study, sampled_errors)
    else:
        ends = rigid_ends(study, sampled_errors)
    turn_values = over_turn_columns(metric_turns(study, metrics, ends[:, 0] - ends[:, 1], motion))
    angles = {name: metrics[name].reshape(len(sampled_errors), -1) for name in library()}
    of_turn = {name: turn_values[f"{name}_{study.limits.over}"] for name in library()}
    return angles, of_turn | {PRELOADED: np.isnan(ends).any(axis=(1, 2))}


def bounds(study: Study | str | Path, jobs: int | Workers | None = None) -> Answer[bounds_results.BoundFindings]:
    """Worst cases over the tolerances of a study, beside linear stacks and capability.

    Parameters
    ----------
    study : or the name or file of one.
    jobs : processes; the study's own number if not given.

    Raises
    ------
    InputError
        If the study has no tolerances with limits.
    """
    study = study_of(study)
    Box.from_study(study)  # says what is missing before anything is run
    finished_run = up_to_date(study, ["aggregate"], jobs)
    study, outputs = finished_run.study, finished_run.outputs
    loop_inputs = prepared_loops(study, outputs)
    units = _random_units(study, pd.DataFrame(outputs["aggregate"].read("units")))
    cranks = study.cycle.curve_crank_deg
    with Line("bounds", "metrics and angles", len(cranks) * len(bounds_results.all_bounded(study))) as line:
        solve = partial(_at_crank, loop_inputs)
        findings = bounds_results.findings(study, cranks, solve, units, partial(line.advance, 1, 0))
    folder = settings.RUNS / "bounds" / study.name
    frames = bounds_results.write(findings, folder)
    write_bounds_page(findings, folder)
    table = frames["bounds"].to_csv(index=False, float_format="%.8g").rstrip("\n")
    return Answer(findings, (table,), folder, frames)


def _at_crank(loop_inputs: hysteresis.Shared, crank_deg: float, sampled_errors: Errors) -> dict[str, np.ndarray]:
    """Every metric of ``n`` units at one loaded crank angle, (n,) each."""
    study, k = loop_inputs.study, loop_inputs.study.cycle.crank_deg.index(crank_deg)
    reduced_study = study.with_section("cycle", crank_deg=(crank_deg,), loaded_angles=None)
    single = replace(loop_inputs.at_some(slice(k, k + 1)), study=reduced_study)
    return {name: values[:, 0] for name, values in at_angles(single, sampled_errors).items()}
