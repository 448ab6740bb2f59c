"""The design and the study of a unit with what was fitted, as files, and what that study leaves."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline import assembly
from pipeline.arrays import Real
from pipeline.config import load_study
from pipeline.config.changing import toml_of
from pipeline.config.dimensions import dimension_library
from pipeline.config.files.section import number_at, with_value
from pipeline.config.reading import parse_design, parse_study
from pipeline.config.studies.study import LAW_FACTORS, Study
from pipeline.config.studies.tolerances import Case, direction_key, elements
from pipeline.constant_kinds import ShownCount
from pipeline.engine.store import write_atomic
from pipeline.errors import InputError
from pipeline.identification.bench.instrument_effects import InstrumentEffect
from pipeline.identification.bench.load_path import Instrument
from pipeline.identification.fitting.data import Data
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import Fit
from pipeline.identification.fitting.problem import Model
from pipeline.identification.fitting.scaled_drives import scaled_design, softness
from pipeline.identification.fitting.stations import stations_of
from pipeline.identification.identify import Identification
from pipeline.identification.selection.criteria import Trial
from pipeline.identification.selection.statements.verdict import (
    ADEQUATE,
    EQUIVALENT,
    IDENTIFIED,
    UNEXPLAINED,
    WITHIN_TOLERANCE,
)
from pipeline.model.effects import Effect
from pipeline.model.effects.effect import TIME
from pipeline.model.units import MM_PER_UM
from pipeline.mounting import drive_of
from pipeline.sampling.errors import draw


@dataclass(frozen=True)
class WrittenStudy:
    """A written study beside the measurement.

    Attributes
    ----------
    study : name of its file.
    angle : (n_cells,) [arcmin] of the unit as measured, else of the nominal one, on the measured torques, with
        the offset of each position.
    rms_arcmin : of what it leaves, each cell counted by its rows.
    fit_rms_arcmin, declared_rms_arcmin : of the fit that it was written from, and of the model as declared.
    """

    study: str
    angle: Real
    rms_arcmin: float
    fit_rms_arcmin: float
    declared_rms_arcmin: float

    @property
    def is_behind(self) -> bool:
        """Whether it is worse than the design as declared."""
        return self.rms_arcmin > self.declared_rms_arcmin


def written_study(identification: Identification, path: Path, fit: Fit) -> WrittenStudy:
    """The study of a file, with its design, on the load history of the unit.

    Parameters
    ----------
    fit : that it was written from.

    Notes
    -----
    Of the fit only the errors of the bench are taken, which are none of the reducer: numbers, effects, dimensions and
    factors of the force laws are those of the files, run in. The disk is the one that was condensed, softer or stiffer
    by modulus and thickness.

    Raises
    ------
    InputError : as ``load_study``.
    """
    study, problem = load_study(path, path.parent), identification.problem
    unit = int(bool(study.cases) and study.samples.nominal_first)  # the unit as measured, else the nominal one
    sample = draw(study, unit, unit + 1)
    factor = softness(study.design) / softness(identification.measurement.unit.study.design)
    clearance = assembly.bearing_clearance(study.design, sample.bearing_clearance)
    angle = np.full(len(problem.data), np.nan)
    bench = Instrument()
    for effect, values in fit.model.split(fit.values.tolist()):
        bench = effect.apply(bench, values) if isinstance(effect, InstrumentEffect) else bench
    cranks = stations_of(identification.measurement, problem.halvings).cranks.tolist()
    for position, stations in enumerate(problem.stations):
        drives = tuple(
            drive_of(study, cranks[k], factor * problem.compliances[k], assembly.errors(sample), clearance)
            for k in stations
        )
        angle[problem.data.position == position] = problem.forward.read(drives, position, bench).angle
    fitter = Fitter(problem)
    declared_angle = fitter.predict(Model(), fitter.start(Model())).angle
    every = np.ones(len(angle), bool)
    curves = [  # zeros of the angle as the fit weighs its cells
        curve + fitter.offsets(curve, every, sigma)
        for curve, sigma in ((angle, fit.sigma), (declared_angle, problem.data.sigma))
    ]
    errors = [_rms(problem.data, curve) for curve in (curves[0], fit.predicted_angle, curves[1])]
    return WrittenStudy(path.name, curves[0], *errors)


def _rms(data: Data, angle: Real) -> float:
    """Root mean square [arcmin] of what a prediction (n_cells,) leaves, each cell counted by its rows."""
    return float(np.sqrt(np.average((data.angle - angle) ** 2, weights=data.count)))


DIGITS: ShownCount = 6
"""Digits of a number that a written design has; its interval is wider."""
AMOUNT_DECIMALS: ShownCount = 4
"""Decimals of a dimension [um] or direction [degrees] that a written study has."""
DESCRIBES = {
    "status": "calibrated",
    "reason": f"describes a measured unit best; NOT CLAIMED, its verdict is {UNEXPLAINED}",
}
BEST_READING = f"Describes the unit {{unit}} best. Not claimed: the verdict is {UNEXPLAINED}, structure is left."
CORRECTED_KIND, BEST_KIND = "corrected", "best"
OF_TEMPERATURE = ("disk_growth", "pins_growth", "housing_growth", "crank_growth")
"""Growth by temperatures that a study draws: no dimension of a unit."""
DESIGN_FILES = {CORRECTED_KIND: "design.toml", BEST_KIND: "best-design.toml"}


def study_file(unit: str, kind: str = CORRECTED_KIND) -> str:
    """Name of the study of a unit's corrected or best model; its run folder has the same stem."""
    return f"{kind}-{unit}.toml"


def corrected_trial(identification: Identification) -> Trial:
    """The model that is written: with the named effect, the best of a class, or with refitted numbers alone."""
    return identification.selection.chosen_trial


def best_trial(identification: Identification) -> Trial | None:
    """The model that describes an unexplained unit best; None where nothing but refitted numbers does."""
    answer = identification.selection.answer
    return answer if identification.verdict.verdict == UNEXPLAINED and answer.fit.model.effects else None


@dataclass(frozen=True)
class Corrected:
    """Paths of the corrected design and study that were written; none, and why."""

    paths: tuple[Path, ...]
    why_not: str = ""


def write_corrected(identification: Identification, folder: Path) -> Corrected:
    """Write the corrected design and study into ``folder``, where it can be built."""
    return _write_design(identification, corrected_trial(identification), CORRECTED_KIND, folder)


def write_best(identification: Identification, folder: Path) -> Corrected:
    """Write the model that describes an unexplained unit best, marked as not claimed, and a study that runs it."""
    trial = best_trial(identification)
    if trial is None:
        return Corrected((), "the verdict's model is the best one")
    return _write_design(identification, trial, BEST_KIND, folder)


def _write_design(identification: Identification, trial: Trial, kind: str, folder: Path) -> Corrected:
    try:
        text, study_text = _design_text(identification, trial, kind), _study_text(identification, trial, kind)
    except InputError as error:
        return Corrected((), f"the refitted numbers make no reducer: {'; '.join(error.problems)}")
    design, study = folder / DESIGN_FILES[kind], folder / study_file(identification.measurement.unit.name, kind)
    write_atomic(design, text.encode())
    write_atomic(study, study_text.encode())
    return Corrected((design, study))


def _design_text(identification: Identification, trial: Trial, kind: str) -> str:
    unit, problem, fit = identification.measurement.unit, identification.problem, trial.fit
    design_before = unit.study.design
    content: dict[str, Any] = scaled_design(
        design_before, problem.calibrated_keys, np.exp(fit.unknowns.scales[: len(problem.calibrated_keys)]).tolist()
    ).model_dump()
    of_best = "description of" if kind == BEST_KIND else "corrected for"
    content["title"] = f"{design_before.title}, {of_best} the unit {unit.name}"
    provenance = content.pop("provenance")
    for key in problem.calibrated_keys:
        content = with_value(content, key, float(f"{number_at(content, key):.{DIGITS}g}"))
        provenance[key] = DESCRIBES if kind == BEST_KIND else _refit_provenance(identification, key)
    intervals = {(p.effect, p.name): p for p in identification.verdict.parameters}
    comments = [_reading(identification) if kind == CORRECTED_KIND else BEST_READING.format(unit=unit.name)]
    for effect, values in fit.model.split(fit.values.tolist()):
        numbers = {p.name: float(f"{v:.{DIGITS}g}") for p, v in zip(effect.parameters, values, strict=True)}
        omission = _not_in_a_study(effect)
        if omission:
            numbers_text = ", ".join(f"{name} = {value:g}" for name, value in numbers.items())
            comments.append(f"{effect.title} ({effect.name}: {numbers_text}) is left out: {omission}.")
            continue
        content["effects"] = {**content["effects"], effect.name: numbers}
        for name in numbers:
            p = intervals.get((effect.name, name))
            ends = f"; 95 % interval {p.ci_low:.4g} to {p.ci_high:.4g}" if p and np.isfinite(p.ci_low) else ""
            named_numbers = {
                "status": "calibrated",
                "reason": f"{effect.title}, identified on the measured unit {unit.name}{ends}",
            }
            provenance[f"effects.{effect.name}.{name}"] = DESCRIBES if kind == BEST_KIND else named_numbers
    rise = float(np.mean([np.mean(of_position.temperature_rise) for of_position in problem.conditions]))
    if rise and content["effects"]:
        content["temperature_rise_K"] = round(rise, 3)
        provenance["temperature_rise_K"] = {"status": "given", "reason": f"mean of the measurement of {unit.name}"}
    content["provenance"] = provenance
    parse_design(content, DESIGN_FILES[kind])
    return "".join(f"# {line}\n" for line in comments) + toml_of(content)


def _reading(identification: Identification) -> str:
    verdict, start = identification.verdict.verdict, f"Verdict on {identification.measurement.unit.name}"
    if verdict == IDENTIFIED:
        return f"{start}: identified."
    if verdict in (EQUIVALENT, WITHIN_TOLERANCE):
        names = ", ".join(identification.verdict.named_effects)
        return f"{start}: {verdict}; the data do not distinguish {names}. The most probable is written."
    if verdict == ADEQUATE:
        return f"{start}: adequate; calibrated numbers are refitted, no effect is added."
    return f"{start}: {verdict}; calibrated numbers are refitted, nothing else is claimed."


def _not_in_a_study(effect: Effect | InstrumentEffect) -> str:
    """Why an effect does not show, or not as measured, in a study of the design."""
    if isinstance(effect, InstrumentEffect):
        return "it belongs to the bench, not to the reducer"
    if TIME in effect.needs:
        return "a study's load cycle has no time"
    return ""


def _refit_provenance(identification: Identification, key: str) -> dict[str, str]:
    """Provenance of a refitted number; marked where it stands at an end of its plausible range."""
    reason = f"refitted to the measured unit {identification.measurement.unit.name}"
    number = {number.key: number for number in identification.verdict.calibrated_numbers}[key]
    declared_value = number_at(identification.measurement.unit.study.design, key)
    low, high = declared_value * number.plausible_low, declared_value * number.plausible_high
    mark = f"; AT AN END of its plausible range, {low:.4g} to {high:.4g}: not plausible" if number.leaves else ""
    return {"status": "calibrated", "reason": reason + mark}


OF_SAMPLES = {"name", "design", "cases", "tolerances", "costs", "drivers", "tails"}
"""Settings of a study that its one case has no use for."""


def _study_text(identification: Identification, trial: Trial, kind: str) -> str:
    unit = identification.measurement.unit
    content = _study_content(unit.study, identification, trial, kind)
    name = study_file(unit.name, kind)
    parse_study(content, Path(name).stem, name, lambda _: unit.study.design)
    comment = (
        f"# Runs the {kind} model of the measured unit {unit.name} at its crank angles, fully run in.\n"
        "# Its one case has the dimensions that were measured, or the usual ones, and on top what was fitted of them.\n"
    )
    return comment + toml_of(content)


def _study_content(study: Study, identification: Identification, trial: Trial, kind: str) -> Mapping[str, Any]:
    unit, problem = identification.measurement.unit, identification.problem
    content: dict[str, Any] = study.model_dump(exclude_defaults=True, exclude=OF_SAMPLES)
    claim = ": a description, no effect is named" if kind == BEST_KIND else ""
    content["title"] = f"{unit.settings.title}: {kind} model"
    content["description"] = f"The {kind} model of the measured unit {unit.name}{claim}."
    cranks = tuple(sorted({round(float(crank) % 360, 6) for crank in identification.measurement.drive_cranks}))
    cycle = {key: value for key, value in content["cycle"].items() if key != "loaded_angles"}
    content["cycle"] = {**cycle, "crank_deg": cranks, "keep_contacts": (0,)}
    factors = np.exp(trial.fit.unknowns.scales[len(problem.calibrated_keys) :]).tolist()
    written_factors = {
        key: float(f"{factor * getattr(study.springs, key):.{DIGITS}g}")
        for (key, *_), factor in zip(LAW_FACTORS, factors, strict=True)
    }
    content["springs"] = {**content.get("springs", {}), **written_factors}
    content["samples"] = {"experiment": "cases", "count": 1, "nominal_first": True}
    content["cases"] = (fitted_dimensions(identification, trial).model_dump(exclude_defaults=True),)
    return {"design": DESIGN_FILES[kind], **{key: value for key, value in content.items() if value != {}}}


def fitted_dimensions(identification: Identification, trial: Trial) -> Case:
    """The dimensions [um] of a unit: measured or usual ones, and on top the fitted amounts of the tolerances' modes."""
    problem, study = identification.problem, identification.measurement.unit.study
    counts = elements(study.design)
    deviations = vars(problem.modes_of_errors(trial.fit.unknowns.modes))
    values: dict[str, Any] = {"label": "as fitted"}
    for name, dimension in dimension_library().items():
        mean_value = getattr(problem.mean_unit, dimension.field, np.empty(0))
        needs_more_disks = dimension.fewest_disks > study.design.disk.count
        if not np.size(mean_value) or name in OF_TEMPERATURE or needs_more_disks or dimension.acts_on:
            continue
        change = deviations.get({"lobe_profile": "lobe"}.get(name, name), np.zeros(1)) / MM_PER_UM
        if dimension.direction:
            vector = mean_value[0] * np.exp(1j * getattr(problem.mean_unit, dimension.phase)[0])
            vector = vector + (change @ np.array([1.0, 1j]) if change.shape[-1] == 2 else 0.0)
            totals = {name: np.abs(vector), direction_key(name): np.degrees(np.angle(vector))}
        else:
            totals = {name: mean_value[0] + change.ravel()}
        if np.any(np.round(totals[name], AMOUNT_DECIMALS)):
            values |= {key: _listed(total, in_list=name in counts) for key, total in totals.items()}
    return Case(**values)


def _listed(total: Real, in_list: bool) -> float | tuple[float, ...]:
    """Rounded values of a case: of elements a list, where there are several."""
    rounded_values = np.ravel(np.round(total, AMOUNT_DECIMALS)).tolist()
    return tuple(rounded_values) if in_list and len(rounded_values) > 1 else float(rounded_values[0])
