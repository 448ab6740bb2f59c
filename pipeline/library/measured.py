"""Questions about measured units: why one differs from its model, what changed, whether many differ from a study."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pipeline import assembly, settings
from pipeline.config import Study
from pipeline.engine.store import write_atomic
from pipeline.errors import InputError
from pipeline.identification.change import results as change_results
from pipeline.identification.change.results import ChangeAnswer
from pipeline.identification.described import results as described_results
from pipeline.identification.described.description import Description, describe
from pipeline.identification.identify import FaultyUnit, identify_measured
from pipeline.identification.measurement.faults.fault import linear_algebra_faults
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.turning.turning_measurement import read_measurement
from pipeline.identification.measurement.unit_file import load_measured_unit, load_measured_units
from pipeline.identification.record import results as record_results
from pipeline.identification.record.answer import RecordAnswer, record_answer
from pipeline.identification.record.turn_record import TurnRecord
from pipeline.identification.results import write as results
from pipeline.identification.selection.statements.verdict import FAULT
from pipeline.identification.series import results as series_results
from pipeline.identification.series.answer import SeriesAnswer, identify_measurements, turns_within_its_loops
from pipeline.library.running import Answer, Workers, study_of, up_to_date
from pipeline.populations import results as population_results
from pipeline.populations.comparison import MetricComparison, load_population, metric_comparisons
from pipeline.populations.single_units import single_units
from pipeline.populations.tolerance_shift import closing, read_population_run
from pipeline.report.unit.page import write_page
from pipeline.report.unit.population import write_description_page, write_population_page
from pipeline.report.unit.record import write_record_page
from pipeline.report.unit.series import write_change_page, write_series_page
from stages.tables.condensed import COMPLIANCE_FILE, full_compliance

INPUTS_FILE = "inputs.txt"
"""File in a folder of results: the folders that they are of, a line each."""

LARGEST_NOISE = 20.0
"""Repeatability of a bench [%] beyond which a number is in another unit."""


@dataclass(frozen=True)
class UnitAnswer(
    Answer[results.Findings | FaultyUnit | Description | SeriesAnswer | Measurement | RecordAnswer | TurnRecord]
):
    """The answer on one measured unit.

    Attributes
    ----------
    verdict : one word, as "identified"; of a drive without a design, as "described".
    content : of ``verdict.json``; empty of a drive without a design.
    """

    verdict: str = ""
    content: Mapping[str, Any] = field(default_factory=dict)


def identify(unit: str | Path, jobs: int | Workers | None = None) -> UnitAnswer:
    """Why a measured unit differs from its model; of a drive without a design, its play, friction and spring.

    Parameters
    ----------
    unit : folder with a ``unit.toml``, or the name of one in data/measured.
    jobs : processes that condense the disk; the study's own number if not given.

    Raises
    ------
    InputError
        If the folder or its data cannot be read.
    """
    settings_of_unit = load_measured_unit(str(unit), settings.ROOT)
    if settings_of_unit.is_record:
        return unit_answer(TurnRecord.read(settings_of_unit), jobs)
    return unit_answer(read_measurement(settings_of_unit), jobs)


def unit_answer(measurement: Measurement | TurnRecord, jobs: int | Workers | None = None) -> UnitAnswer:
    """As ``identify``, of a measurement that has been read."""
    folder = _results_folder("identify", measurement.unit.name, [measurement.unit.folder])
    if isinstance(measurement, TurnRecord):
        return _of_record(measurement, folder)
    if measurement.unit.design_study is None:
        if not measurement.fatal and turns_within_its_loops(measurement):
            return _turning(measurement, folder)
        return _description_answer(measurement, folder)

    def full_compliances(study: Study, cranks: Sequence[float]) -> list[np.ndarray]:
        at_cranks = study.with_section("cycle", crank_deg=tuple(float(crank) for crank in cranks))
        path = up_to_date(at_cranks, ["reduce"], jobs).outputs["reduce"].path(COMPLIANCE_FILE)
        return [full_compliance(path, assembly.reducer(study.design, crank), crank) for crank in cranks]

    with linear_algebra_faults(measurement.unit.name):
        identification = identify_measured(measurement, full_compliances)
    findings = identification if isinstance(identification, FaultyUnit) else results.findings(identification)
    content, frames = results.write(findings, folder)
    write_page(findings, content, frames, folder, settings.shown(folder))
    verdict, statement = identification.verdict.verdict, identification.statement
    sentences = _sentences(verdict, statement.sentence, content["advice"])
    return UnitAnswer(findings, sentences, folder, frames, verdict=verdict, content=content)


def _results_folder(command: str, name: str, inputs: Sequence[Path]) -> Path:
    """The folder for results of these input folders.

    Raises
    ------
    InputError
        If it has the results of other folders of the same name, and these still exist.
    """
    folder = settings.RUNS / command / name
    file, paths = folder / INPUTS_FILE, [path.resolve() for path in inputs]
    lines = file.read_text(errors="surrogateescape").splitlines() if file.is_file() else []
    previous_paths = [Path(line) for line in lines] or paths
    if previous_paths != paths and all(path.exists() for path in previous_paths):
        raise InputError(
            f"{settings.shown(folder)} has the results of {', '.join(map(str, previous_paths))}, which would be "
            f"overwritten by those of {', '.join(map(str, paths))}; rename a folder, or move these results away"
        )
    write_atomic(file, "\n".join(map(str, paths)).encode(errors="surrogateescape"))
    return folder


def _description_answer(measurement: Measurement, folder: Path) -> UnitAnswer:
    """The answer on a drive of which no design is known."""
    if measurement.fatal:
        sentence = results.write_fault(measurement.unit.name, measurement.faults, folder)
        return UnitAnswer(measurement, (f"{FAULT}: {sentence}",), folder, page="", verdict=FAULT)
    with linear_algebra_faults(measurement.unit.name):
        description = describe(measurement)
    residual_signatures, frames = described_results.write(description, folder)
    write_description_page(description, residual_signatures, frames, folder, settings.shown(folder))
    sentences = _sentences(
        description.verdict, described_results.sentence(description), described_results.advice(description)
    )
    return UnitAnswer(description, sentences, folder, frames, verdict=description.verdict)


def _turning(measurement: Measurement, folder: Path) -> UnitAnswer:
    """The answer on a drive of which no design is known and whose crank turns within its loops."""
    with linear_algebra_faults(measurement.unit.name):
        answer = identify_measurements([measurement])
    frames = series_results.write(answer, folder)
    write_series_page(answer, frames, folder, settings.shown(folder))
    sentences = _sentences(answer.verdict, answer.sentence, answer.advice)
    return UnitAnswer(answer, sentences, folder, frames, verdict=answer.verdict)


def _of_record(record: TurnRecord, folder: Path) -> UnitAnswer:
    """The answer on a record of a turning drive."""
    if record.fatal:
        sentence = results.write_fault(record.unit.name, record.faults, folder)
        return UnitAnswer(record, (f"{FAULT}: {sentence}",), folder, page="", verdict=FAULT)
    with linear_algebra_faults(record.unit.name):
        answer = record_answer(record)
    frames = record_results.write(answer, folder)
    write_record_page(answer, frames, folder, settings.shown(folder))
    content = record_results.content(answer)
    return UnitAnswer(
        answer, record_results.sentences(answer), folder, frames, verdict=answer.judgement.verdict, content=content
    )


def _sentences(verdict: str, sentence: str, advice: str) -> tuple[str, ...]:
    return (f"{verdict}: {sentence}", *([advice] if advice else []))


def states_of(
    folder_before: str | Path, folder_after: str | Path, also: Sequence[str | Path] = ()
) -> list[Measurement]:
    """Measurements of two states of a drive and of further ones, which are folders of states or single ones.

    Raises
    ------
    InputError
        If a folder or its data cannot be read.
    """
    units = [load_measured_unit(str(name), settings.ROOT) for name in (folder_before, folder_after)]
    known_folders = [unit.folder.resolve() for unit in units]
    further = [
        unit
        for name in also
        for unit in load_measured_units(str(name), settings.ROOT)
        if unit.name == Path(name).name or unit.folder.resolve() not in known_folders
    ]
    return [Measurement.read(unit) for unit in (*units, *further)]


def changed(before: str | Path, after: str | Path, also: Sequence[str | Path] = ()) -> Answer[ChangeAnswer]:
    """What changed between two measurements of one drive.

    Parameters
    ----------
    before, after : folders with a ``unit.toml``, or names of them in data/measured.
    also : further states of the drive, or folders of them: they give the scatter of mounting.

    Raises
    ------
    InputError
        If a folder or its data cannot be read, or the states cannot be compared.
    """
    return compared_states(states_of(before, after, also))


def compared_states(states: Sequence[Measurement]) -> Answer[ChangeAnswer]:
    """As ``changed``, of measurements that have been read: before, after, further ones."""
    state_before, state_after, *further = states
    names = f"{state_before.unit.name}-{state_after.unit.name}"
    folder = _results_folder("changed", names, [state_before.unit.folder, state_after.unit.folder])
    with linear_algebra_faults(f"{state_before.unit.name}, {state_after.unit.name}"):
        answer = change_results.answer(state_before, state_after, further)
    frames = change_results.write(answer, folder)
    write_change_page(answer, frames, folder, settings.shown(folder))
    sentences = (
        f"{answer.comparison.verdict}: {answer.sentence}",
        answer.limits_sentence,
        answer.unmeasured_sentence,
        answer.pattern_sentence,
        answer.advice,
    )
    return Answer(answer, tuple(filter(None, sentences)), folder, frames)


def series_of(folder: str | Path) -> list[Measurement]:
    """Measurements of all states of a drive, each in its folder of one.

    Raises
    ------
    InputError : one cannot be read, or there are fewer than two.
    """
    units = load_measured_units(str(folder), settings.ROOT)
    if len(units) < 2:
        raise InputError("a series has 2 or more states; name a folder with a folder of each, or use --unit")
    return [Measurement.read(unit) for unit in units]


def identify_series(folder: str | Path, over: str = "") -> Answer[SeriesAnswer]:
    """What several states of one drive share, and how each differs.

    Parameters
    ----------
    folder : has a folder with a ``unit.toml`` for each state.
    over : variable of ``[state]`` that orders them; by default the first that all have.

    Raises
    ------
    InputError
        If the folder or its data cannot be read, or the states cannot be compared.
    """
    return shared_by_states(series_of(folder), folder, over)


def shared_by_states(measurements: Sequence[Measurement], folder: str | Path, over: str = "") -> Answer[SeriesAnswer]:
    """As ``identify_series``, of measurements that have been read."""
    runs = _results_folder("series", Path(folder).resolve().name, [Path(folder)])
    answer = identify_measurements(measurements, over)
    frames = series_results.write(answer, runs)
    write_series_page(answer, frames, runs, settings.shown(runs))
    sentences = (f"{answer.verdict}: {answer.sentence}", answer.trend_sentence, answer.advice)
    return Answer(answer, tuple(filter(None, sentences)), runs, frames)


def population(
    units: str | Path,
    study: Study | str | Path,
    over: str = "mean",
    jobs: int | Workers | None = None,
    noise_percent: float | None = None,
) -> Answer[list[MetricComparison]]:
    """Many measured units against the distributions of a study.

    Parameters
    ----------
    units : CSV file, one row per unit with its metrics.
    study : or the name or file of one.
    over : "mean" or "worst" over the study's crank angles, for units without ``crank_deg``.
    jobs : processes; the study's own number if not given.
    noise_percent : repeatability of the bench, the standard deviation of a value in percent of it. Without it no
        single unit is tested, nor are all units together unless they outnumber the metrics by two.

    Raises
    ------
    InputError
        If the file, the study or the noise is wrong.
    """
    units = Path(units)
    if noise_percent is not None and not 0 <= noise_percent <= LARGEST_NOISE:
        raise InputError(f"--noise {noise_percent:g}: must be 0 to {LARGEST_NOISE:g} percent of a value")
    noise = None if noise_percent is None else noise_percent / 100
    measured_population = load_population(units)
    study = up_to_date(study_of(study), ["aggregate"], jobs).study
    samples = read_population_run(settings.RUNS / study.name, study)
    confidence = study.metrics.confidence
    comparisons = metric_comparisons(measured_population, samples.metrics, confidence, turn_statistic=over)
    with linear_algebra_faults(units.name):
        closings = {
            crank: closing([entry for entry in comparisons if entry.crank_deg == crank], samples, confidence, noise)
            for crank in dict.fromkeys(entry.crank_deg for entry in comparisons)
        }
    folder = settings.RUNS / "population" / study.name
    single = single_units(measured_population, samples.metrics, over, noise)
    frames = population_results.write(comparisons, closings, single, folder)
    write_population_page(
        study, units.name, over, comparisons, closings, single, noise_percent=noise_percent, folder=folder
    )
    every_angle = f"{over} over {len(study.cycle.crank_deg)} crank angles"
    sentences = [
        f"{every_angle if crank is None else f'crank at {crank:g} deg'}: "
        f"{population_results.sentence(of_crank, [entry for entry in comparisons if entry.crank_deg == crank])}"
        for crank, of_crank in closings.items()
    ]
    sentences += [group.sentence for group in single]
    table = frames["comparison"].to_csv(index=False, float_format="%.8g").rstrip("\n")
    return Answer(comparisons, (table, *sentences), folder, frames, page="population.html")
