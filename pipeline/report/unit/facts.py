"""What the page on a measured unit says in words: its data, the errors beside the model's, and what is left."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.identification.fitting.offered import turn_of_held_crank
from pipeline.identification.identify import FaultyUnit, Identification
from pipeline.identification.measurement.enough import UNLOADED_SHARE
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.turning.turning_measurement import TurningMeasurement
from pipeline.identification.selection.criteria import NAMED_ODDS
from pipeline.identification.selection.statements.discrepancy import Discrepancy
from pipeline.identification.selection.statements.remainder import Remainder
from pipeline.identification.selection.statements.statement import title_of
from pipeline.identification.selection.statements.verdict import UNEXPLAINED
from pipeline.report.layout import count_text, listed_text, plain_number
from pipeline.report.unit.rows import digits, interval, scatter_words, shown_unit, with_capital
from pipeline.sampling.errors import unmeasured_dimensions

LEAST_STRUCTURE = 0.005
"""Share of the mean square of what is left below which its shape is not shown."""


def discrepancy_facts(
    structure: Discrepancy, moved_facts: Sequence[tuple[str, float, float, str]]
) -> list[tuple[str, str]]:
    """What is left as a Gaussian process, in words; ``moved_facts``: name, change, standard error, unit."""
    if structure.structured < LEAST_STRUCTURE:
        return [("Structured", "nothing: what is left is noise")]
    sense = "rising" if structure.worst_sense > 0 else "falling"
    facts = [
        ("Structured", f"{digits(100 * structure.structured, 2)} % of the mean square of what is left"),
        ("Shared by all positions", f"{digits(structure.common_arcmin)} arcmin"),
        ("Of each position by itself", f"{digits(structure.own_arcmin)} arcmin"),
        ("Alike over", f"{digits(structure.reach_Nm)} N m"),
        (
            "Largest",
            f"{digits(structure.worst_arcmin)} arcmin at {digits(structure.worst_torque_Nm)} N m, torque {sense}",
        ),
    ]
    for name, change, error, unit in moved_facts:
        significance = "by more than its uncertainty" if abs(change) > 2 * error else "within its uncertainty"
        text = f"moves by {digits(change)} {unit}".rstrip()
        facts.append((with_capital(name), f"{text} when the term is allowed, {significance} ({digits(2 * error)})"))
    return facts


def structure_facts(identification: Identification) -> list[tuple[str, str]]:
    """What the model leaves, in words; nothing where nothing is left."""
    residual = identification.discrepancy
    if residual is None:
        return []
    effects = identification.selection.answer.fit.model.effects
    parameters = [(f"{effect.title}, {p.meaning}", shown_unit(p.unit)) for effect in effects for p in effect.parameters]
    rows = zip(parameters, residual.moved.tolist(), residual.error.tolist(), strict=True)
    return discrepancy_facts(residual, [(name, change, error, unit) for (name, unit), change, error in rows])


def interpolation_sentence(identification: Identification) -> str:
    """Error between the crank angles that a model is condensed at; empty where the crank is held."""
    if identification.between_cranks is None:
        return ""
    counts = [len(stations) for stations in identification.problem.stations]
    return (
        f"The model is condensed at {listed_text(sorted({str(count) for count in counts}))} crank angles for each "
        "position. Between them the angle is interpolated by a cubic spline, or by a parabola if there are three. "
        f"Halfway between two of them it is off by at most {digits(identification.between_cranks)} arcmin."
    )


def held_crank_sentence(identification: Identification) -> str:
    """That the model holds the crank of a locked output, and how far the data let it turn; empty for another end."""
    measurement = identification.measurement
    settings = measurement.unit.settings
    if settings.locked != "output" or settings.crank.moves != "fixed":
        return ""
    turn = turn_of_held_crank(measurement)
    stated = "says that the crank is fixed" if "crank" in settings.model_fields_set else "states no [crank]"
    other = ": the predictions are then of another crank angle, and its effects are not seen"
    turned = f"turned by up to {turn.deg:.3g}\u00b0 within a position{other if turn.leaves_pitch else ''}"
    return (
        f"The output was locked and unit.toml {stated}, so the crank is taken to stand still. If the angle was read at "
        f"the motor, the crank {turned}."
    )


def limits_note(identification: Identification) -> tuple[str, str] | None:
    """What the sizes that could hide do not exclude, and why; None where the refitted model leaves nothing."""
    if identification.verdict.verdict == UNEXPLAINED:
        return "These sizes exclude nothing here:", (
            "structure is left that no effect of the library explains. It would refuse any name, so that none would be "
            "named at any size. A size that would be noticed is of an effect in addition to what the refitted model "
            "misses, which may contain the same effect."
        )
    if max(identification.selection.odds.values(), default=0.0) >= NAMED_ODDS:
        return "An effect is noticed already,", (
            "and not named: see what was tried. These sizes are of an effect in addition to what the refitted model "
            "misses, which may contain the same effect."
        )
    return None


def comparison_sentence(identification: Identification) -> str:
    """Whether the model beats the best of the baselines."""
    if not identification.baselines:
        return "Every baseline interpolates the data here, so no comparison is made."
    title, best_error = min(identification.baselines.items(), key=lambda item: item[1].to_noise)
    ratio = identification.errors["after"].to_noise / best_error.to_noise
    comparison, factor = ("behind", ratio) if ratio > 1 else ("ahead of", 1 / ratio)
    in_noise = f"by a factor of {digits(factor)} in multiples of the noise"
    return f"The model is {comparison} the best of them, {title}, {in_noise}."


def tolerances_sentence(identification: Identification) -> str:
    """Which dimensions were measured, and what stands for those that were not."""
    unit = identification.measurement.unit
    modes = f"{count_text(identification.problem.n_modes, 'mode')} represent how units of the study's"
    if unit.dimensions is None:
        return f"The tolerances were not measured: {modes} distributions differ."
    names = [name.replace("_", " ") for name in unmeasured_dimensions(unit.study, unit.dimensions)]
    uncertainty = f"each with a standard uncertainty of {unit.settings.measured_to_um:g} um"
    if not names:
        return f"All tolerances are as measured, {uncertainty}."
    file = unit.settings.as_measured
    return (
        f"Tolerances that {file} does not state were not measured ({listed_text(names)}): {modes} distributions "
        f"differ. The others are as measured, {uncertainty}."
    )


def data_sentence(identification: Identification) -> str:
    """Which cells the errors are of, and which model each fold chose."""
    if identification.folds.in_sample:
        return "These data were used for the fit; none were left to test it."
    names = [title_of(name) if name else "nothing added" for name in identification.folds.models]
    if not any(identification.folds.models):
        return "On data that were not used for the fit."
    are_equal = len(set(names)) == 1
    choice_text = f"all {len(names)} chose {names[0]}" if are_equal else f"they chose {'; '.join(names)}"
    return f"On data that were not used for the fit. Of the cross-validation folds, {choice_text}."


def rows_facts(identification: Identification | FaultyUnit) -> list[tuple[str, str]]:
    """What was read."""
    rows = identification.measurement.rows
    are_unknown = identification.measurement.unit.settings.crank_angles == "unknown"
    note = ", which only distinguish positions: the angles are not known" if are_unknown else ""
    return [
        ("Rows", f"{count_text(len(rows), 'row')} in {count_text(len(rows.files), 'file')}"),
        crank_fact(identification.measurement, note),
    ]


def crank_fact(measurement: Measurement, note: str) -> tuple[str, str]:
    """Where the crank stood, or how it turned."""
    rows = measurement.rows
    if not isinstance(measurement, TurningMeasurement):
        return "Crank angles", listed_text([f"{plain_number(crank)}°" for crank in rows.cranks.tolist()]) + note
    width, torques = measurement.motion.width, [f"{digits(level)} N m" for level in measurement.motion.levels.tolist()]
    pitches = count_text(measurement.motion.pitches, "pitch", "pitches")
    return (
        "Turning crank",
        f"{count_text(len(rows.cranks), 'interval')} of {digits(width)}° ({pitches} of the pins), held torques "
        f"{listed_text(torques)}; orders of the crank above {digits(180 / width)} are averaged out",
    )


def data_facts(identification: Identification) -> list[tuple[str, str]]:
    """What the fit rests on: cells, what is held out, and noise."""
    measurement = identification.measurement
    noise = measurement.noise_of(identification.problem.training)
    scatters: Sequence[tuple[str, Any]] = (
        ("Scatter of repeats, drift and running in included", noise.repeats),
        ("Scatter within a branch", noise.within_branch),
        ("Between positions", noise.between_positions),
    )
    held_out_by = "crank positions" if len(measurement.rows.cranks) > 1 else "cycles"
    if isinstance(measurement, TurningMeasurement):
        held_out_by = f"{measurement.held_out_by or 'turn'}s"
    train = measurement.unit.settings.held_out.train
    counts = count_text(len(measurement.branches), "branch", "branches"), count_text(len(measurement.cells), "cell")
    return [
        *rows_facts(identification),
        ("Branches and cells", ", ".join(counts)),
        *([] if isinstance(measurement, TurningMeasurement) else _rows_not_compared(measurement)),
        ("Held out", "what unit.toml names" if train else f"whole {held_out_by}, {_groups(identification)}"),
        ("Noise floor of a cell", f"{digits(identification.problem.data.noise)} arcmin: {noise.floor.words}"),
        *(
            (title, f"{digits(rms.value)} arcmin, interval {interval(rms.ci_low, rms.ci_high) or 'not determined'}")
            for title, rms in scatters
        ),
        ("Noise of the torque", f"{digits(noise.torque_noise_Nm)} N m a row"),
        ("Left from position to position", _scatter(identification.remainder)),
    ]


def _groups(identification: Identification) -> str:
    """How the parts of the data were left out: each by itself, or in groups."""
    problem, groups = identification.problem, len(identification.folds.models)
    if groups < len(np.unique(problem.data.held_out_parts(problem.training))):
        return f"left out in {groups} groups, each predicted by a fit to the other groups"
    return "each predicted by a fit to the others"


def _rows_not_compared(measurement: Measurement) -> list[tuple[str, str]]:
    """What is left out of the rows that could be read."""
    counts_and_words = [
        (
            _early_rows(measurement),
            f"of the first branches, below {100 * UNLOADED_SHARE:.0f} % of the largest torque, which depend on what "
            "came before the record",
        ),
        (
            int(np.sum(measurement.is_in_play)),
            "within the play or held at no torque, where the drive does not determine the angle",
        ),
    ]
    words = [f"{count_text(count, 'row')} {which}" for count, which in counts_and_words if count]
    return [("Not compared", listed_text(words))] if words else []


def _early_rows(measurement: Measurement) -> int:
    """Usable rows before the first cell of each position."""
    cells, rows = measurement.cells, np.flatnonzero(measurement.usable)
    _, first_cells = np.unique(cells.position, return_index=True)
    first_rows = cells.first_row[first_cells]
    positions = measurement.rows.position
    return sum(int(np.sum((positions[rows] == positions[row]) & (rows < row))) for row in first_rows.tolist())


def _scatter(remainder: Remainder) -> str:
    """What the best model leaves of the scatter between positions."""
    words = scatter_words(remainder)
    return words if remainder.scatter is None else f"{digits(remainder.scatter.size)} arcmin: {words}"
