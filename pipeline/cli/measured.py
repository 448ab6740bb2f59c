"""Commands on measured units: why one differs from its model, and whether many differ from a study."""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline import assembly
from pipeline.cli import settings
from pipeline.cli.running import up_to_date
from pipeline.config import Study, load_study
from pipeline.identification.change import results as change_results
from pipeline.identification.change.results import answer
from pipeline.identification.described import results as described_results
from pipeline.identification.described.description import described
from pipeline.identification.identify import FaultyUnit, identify_measured
from pipeline.identification.measurement.faults.fault import determined
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit, load_measured_units
from pipeline.identification.results import write as results
from pipeline.identification.selection.statements.verdict import FAULT
from pipeline.identification.series import results as series_results
from pipeline.identification.series.results import identify_measurements
from pipeline.population import results as population_results
from pipeline.population.comparison import compared, load_population
from pipeline.population.single_units import single_units
from pipeline.population.tolerance_shift import closing, read_population_run
from pipeline.report.unit.change import write_change_page
from pipeline.report.unit.description import write_description_page
from pipeline.report.unit.page import write_page
from pipeline.report.unit.population import write_population_page
from pipeline.report.unit.series import write_series_page
from stages.tables.condensed import COMPLIANCE_FILE, full_compliance


def identify_designed(measurement: Measurement, options: argparse.Namespace) -> None:
    """Say why a measured unit differs from the model of its design."""

    def condensed(study: Study, cranks: Sequence[float]) -> list[np.ndarray]:
        at_cranks = study.model_copy(
            update={"cycle": study.cycle.model_copy(update={"crank_deg": tuple(float(crank) for crank in cranks)})}
        )
        outputs = up_to_date(at_cranks, ["reduce"], options).outputs
        path = outputs["reduce"].path(COMPLIANCE_FILE)
        return [full_compliance(path, assembly.reducer(study.design, crank), crank) for crank in cranks]

    with determined(measurement.unit.name):
        identification = identify_measured(measurement, condensed)
    folder = settings.RUNS / "identify" / measurement.unit.name
    findings = identification if isinstance(identification, FaultyUnit) else results.findings(identification)
    results.write(findings, folder)
    write_page(findings, folder, settings.shown(folder))
    print(f"{identification.verdict.verdict}: {identification.statement.sentence}")
    if identification.statement.advice:
        print(identification.statement.advice)
    print(f"report: {settings.shown(folder / 'report.html')}")


def describe_generic(measurement: Measurement) -> None:
    """Describe a measured drive of which no design is known."""
    folder = settings.RUNS / "identify" / measurement.unit.name
    if measurement.fatal:
        print(f"{FAULT}: {described_results.write_fault(measurement, folder)}")
        return
    with determined(measurement.unit.name):
        description = described(measurement)
    residual_signatures = described_results.write(description, folder)
    write_description_page(description, residual_signatures, folder, settings.shown(folder))
    print(f"{description.verdict}: {described_results.sentence(description)}")
    if advice := described_results.advice(description):
        print(advice)
    print(f"report: {settings.shown(folder / 'report.html')}")


def identify_series(options: argparse.Namespace) -> None:
    """Say what several states of one drive share, and how each differs."""
    units = load_measured_units(options.series, settings.ROOT)
    measurements = [Measurement.read(unit) for unit in units]
    print("\n".join(line for measurement in measurements for line in measurement.summary), flush=True)
    series_answer = identify_measurements(measurements, options.over)
    folder = settings.RUNS / "series" / Path(options.series).resolve().name
    series_results.write(series_answer, folder)
    write_series_page(series_answer, folder, settings.shown(folder))
    print(f"{series_answer.verdict}: {series_answer.sentence}")
    print("\n".join(filter(None, [series_answer.trend_sentence, series_answer.advice])))
    print(f"report: {settings.shown(folder / 'report.html')}")


def compare_states(options: argparse.Namespace) -> None:
    """Say what changed between two measurements of one drive."""
    compared = [load_measured_unit(name, settings.ROOT) for name in (options.before, options.after)]
    known = [unit.folder.resolve() for unit in compared]
    further = [
        unit
        for name in options.also
        for unit in load_measured_units(name, settings.ROOT)
        if unit.name == Path(name).name or unit.folder.resolve() not in known
    ]
    state_before, state_after, *more_states = (Measurement.read(unit) for unit in (*compared, *further))
    print("\n".join(line for state in (state_before, state_after, *more_states) for line in state.summary), flush=True)
    with determined(f"{state_before.unit.name}, {state_after.unit.name}"):
        answers = answer(state_before, state_after, more_states)
    folder = settings.RUNS / "changed" / f"{state_before.unit.name}-{state_after.unit.name}"
    change_results.write(answers, folder)
    write_change_page(answers, folder, settings.shown(folder))
    print(
        "\n".join(
            filter(
                None,
                [
                    f"{answers.comparison.verdict}: {answers.sentence}",
                    answers.limits_sentence,
                    answers.unmeasured_sentence,
                    answers.pattern_sentence,
                    answers.advice,
                ],
            )
        )
    )
    print(f"report: {settings.shown(folder / 'report.html')}")


def compare_population(options: argparse.Namespace) -> None:
    """Hold measured units against the distributions of a study."""
    units = load_population(options.units)
    study = up_to_date(load_study(options.study, settings.ROOT), ["aggregate"], options).study
    population = read_population_run(settings.RUNS / study.name, study)
    confidence = study.metrics.confidence
    comparisons = compared(units, population.metrics, confidence, over=options.over)
    with determined(options.units.name):
        closings = {
            crank: closing(
                [comparison for comparison in comparisons if comparison.crank_deg == crank], population, confidence
            )
            for crank in dict.fromkeys(comparison.crank_deg for comparison in comparisons)
        }
    folder = settings.RUNS / "population" / study.name
    single = single_units(units, population.metrics, options.over)
    population_results.write(comparisons, closings, single, folder)
    write_population_page(study, options.units.name, options.over, comparisons, closings, single, folder)
    print((folder / "comparison.csv").read_text(), end="")
    for crank, comparison in closings.items():
        angles = (
            f"{options.over} over {len(study.cycle.crank_deg)} crank angles"
            if crank is None
            else f"crank at {crank:g} deg"
        )
        print(f"{angles}: {population_results.sentence(comparison)}")
    for group in single:
        print(group.sentence)
    print(f"page: {settings.shown(folder / 'population.html')}")
