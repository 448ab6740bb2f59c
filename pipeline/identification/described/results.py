"""What the description of a drive leaves behind: its sentence, verdict.json and tables."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.engine.store import write_json, write_tables
from pipeline.engine.table import Columns, Table
from pipeline.identification.described.description import FULLY_DESCRIBED, Description, Number
from pipeline.identification.measurement.enough import FEWEST_COMPARED
from pipeline.identification.measurement.faults.branch_faults import FEWEST_BLOCKS
from pipeline.identification.results.residual_signatures import Signature, signatures
from pipeline.identification.results.tables import SIGNATURES, cell_columns, signature_rows, values_of_cells
from pipeline.identification.results.write import finite
from pipeline.identification.selection.statements.verdict import VERDICT_FILE

TITLES = {"spring": "a spring alone", "described": "play, friction and a spring"}
LARGEST_PLAY_ARCMIN = 300.0
"""Play of no reducer: metal ones have up to 10 arcmin, the printed ones that were measured 20 to 200."""
LARGEST_FRICTION = 0.3
"""Friction, as a share of the rated torque, with which no drive is rated."""
UNSETTLED = ("play", "friction", "load_friction")
"""Terms that a further measurement is advised for where they are not claimed."""
HELD = (
    "Warning: [crank] is not used here, and these numbers are of a crank that stands still. A crank that turns is "
    "fitted to four or more positions of known crank_deg without [held_out] train, or to several states: make identify "
    "SERIES=<folder>."
)
"""Of a drive without a design whose crank turns within its loops."""
NOT_DESCRIBED = ("time_s", "temperature_C")
"""Of a cell, what no term of a description depends on."""
DESCRIPTION = Table(
    "description",
    "cell: measured rows averaged over neighbouring torques of one branch",
    tuple(column for column in cell_columns(TITLES) if column.name not in NOT_DESCRIBED),
)


def write(description: Description, folder: Path) -> tuple[tuple[Signature, ...], dict[str, pd.DataFrame]]:
    """Write tables and, last, the verdict into ``folder``; the signatures of what is left, and the frames by name."""
    remaining_signatures = signatures(description.measurement, description.data, description.curves["described"])
    signatures_before = signatures(description.measurement, description.data, description.curves["spring"])
    by_stage = {"recalibrated": signatures_before, "after": remaining_signatures}
    frames = write_tables({DESCRIPTION: cell_rows(description), SIGNATURES: signature_rows(by_stage)}, folder)
    write_json(folder / VERDICT_FILE, content(description))
    return remaining_signatures, frames


def sentence(description: Description) -> str:
    """The verdict in words; its errors are those of the cards and tables."""
    spring, model = description.errors["spring"], description.errors["described"]
    basis = "in sample" if description.in_sample else "on held-out data"
    errors = (
        f"Root mean square {basis}: {spring.rms_arcmin:.3g} arcmin by a spring alone, {model.rms_arcmin:.3g} arcmin "
        f"({model.to_noise:.3g} × measurement noise) with play and friction."
    )
    named_numbers = [number for number in description.numbers if number.named]
    doubts = "".join(f" {doubt}" for doubt in implausible_numbers(description))
    if not named_numbers:
        return f"No term beside a spring is claimed. {errors}{doubts}"
    remaining_text = "" if description.verdict == FULLY_DESCRIBED else " What is left is structured and not traced."
    return f"{'; '.join(_words(number) for number in named_numbers)}. {errors}{remaining_text}{doubts}"


def implausible_numbers(description: Description) -> list[str]:
    """Warnings of a play or a friction that no drive of this rated torque has, and of numbers at a bound."""
    values = {number.name: number for number in description.numbers}
    rated_torque = description.measurement.unit.rated_torque_Nm
    check = "check side, unit and factor in unit.toml."
    doubts = [f"Warning: {_title(number)} is {number.note}." for number in values.values() if number.note]
    if (play := values["play_arcmin"].value) > LARGEST_PLAY_ARCMIN:
        doubts.append(
            f"Warning: a play of {play:.3g} arcmin is implausible (at most {LARGEST_PLAY_ARCMIN:g} on "
            f"drives that were measured); {check}"
        )
    if values["friction_Nm"].value > LARGEST_FRICTION * rated_torque:
        share = 100 * values["friction_Nm"].value / rated_torque
        doubts.append(f"Warning: a friction of {share:.0f} % of the rated torque is implausible; {check}")
    if description.measurement.unit.settings.crank.moves != "fixed":
        doubts.append(HELD)
    return doubts


def advice(description: Description) -> str:
    """What to measure next."""
    blocks = len(np.unique(description.data.block[description.cells]))
    if description.in_sample or blocks < FEWEST_BLOCKS:
        return (
            f"Measure at least {FEWEST_COMPARED} positions or cycles: "
            "whole ones can then be held out and terms claimed."
        )
    unsettled_terms = [
        number.term.replace("_", " ") for number in description.numbers if number.term in UNSETTLED and not number.named
    ]
    if unsettled_terms:
        names = ", ".join(unsettled_terms)
        return f"Not claimed: {names}. Loops to a tenth, a half and all of the load part play from friction."
    return ""


def turned_deg(description: Description) -> float:
    """Largest turn of the input within a loop [deg]; none where the input is locked."""
    unit = description.measurement.unit.settings
    if unit.locked == "input" or unit.generic is None:
        return 0.0
    spans = [
        np.ptp(description.data.angle[description.data.position == p]) for p in np.unique(description.data.position)
    ]
    return float(max(spans)) / 60 * unit.generic.ratio


def cell_rows(description: Description) -> Columns:
    """Columns of `DESCRIPTION`."""
    values = values_of_cells(description.measurement, description.data, description.cells, description.curves)
    return {column.name: values[column.name] for column in DESCRIPTION.columns}


def content(description: Description) -> dict[str, Any]:
    """Content of verdict.json."""
    verdict: dict[str, Any] = finite(
        {
            "unit": description.measurement.unit.name,
            "title": description.measurement.unit.settings.title,
            "verdict": description.verdict,
            "sentence": sentence(description),
            "advice": advice(description),
            "numbers": [asdict(number) for number in description.numbers],
            "held_out_errors": {name: asdict(error) for name, error in description.errors.items()},
            "baselines": {title: asdict(error) for title, error in description.baselines.items()},
            "in_sample": description.in_sample,
            "discrepancy": description.structure.as_json if description.structure else None,
            "noise_arcmin": description.data.noise,
            "input_turns_deg": turned_deg(description),
            "data_faults": [asdict(fault) for fault in description.measurement.faults],
        }
    )
    return verdict


def _words(number: Number) -> str:
    """A named number with its interval."""
    unit = "" if number.unit == "1" else f" {number.unit}"
    name = _title(number)
    return f"{name[:1].upper()}{name[1:]} {number.value:.3g}{unit} ({number.ci_low:.3g} to {number.ci_high:.3g})"


def _title(number: Number) -> str:
    return number.meaning.split(":")[0].split(",")[0]
