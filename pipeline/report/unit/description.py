"""The page on a drive of which no design is known."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from pipeline.engine.store import write_atomic
from pipeline.figures.measured_unit import DESCRIPTION_STYLES, REMAINDER_TITLES, loops_figure, torque_figure
from pipeline.identification.described.description import Description, Number
from pipeline.identification.described.results import TITLES, content
from pipeline.identification.results.residual_signatures import Signature
from pipeline.report.layout import drawn_pictures, render
from pipeline.report.unit.facts import discrepancy_facts
from pipeline.report.unit.rows import digits, interval

CAPTIONS = {
    "loops": (
        "Loops",
        "Dots: cells, averages of neighbouring rows of a branch. Lines: predictions of fits that have not seen the "
        "held-out cells. The offset of the angle is removed.",
    ),
    "torque": ("Residual over torque", "Branches that part show friction, a step at zero torque play."),
}


def write_description_page(
    description: Description,
    signatures_left: Sequence[Signature],
    frames: dict[str, pd.DataFrame],
    folder: Path,
    shown_folder: Path,
) -> None:
    """Write report.html and its figures into ``folder``.

    Parameters
    ----------
    signatures_left : signatures of what the description leaves.
    frames : tables that were written there.
    shown_folder : the folder as a user would type it.
    """
    cells = frames["description"]
    figures = {"loops": loops_figure(cells, DESCRIPTION_STYLES), "torque": torque_figure(cells, REMAINDER_TITLES)}
    pictures = drawn_pictures(figures, CAPTIONS, folder)
    errors = {TITLES[name].capitalize(): error for name, error in description.errors.items()} | dict(
        description.baselines
    )
    page = render(
        "unit/description.html",
        verdict=content(description),
        numbers=[_number(number) for number in description.numbers],
        errors=[
            (title[:1].upper() + title[1:], digits(e.rms_arcmin), digits(e.to_noise)) for title, e in errors.items()
        ],
        signatures=[_signature(signature) for signature in signatures_left if not signature.why_not],
        left=_remaining_facts(description),
        folder=shown_folder,
        tables=list(frames),
        faults=[(description.measurement.unit.name, fault) for fault in description.measurement.faults],
        pictures=pictures,
    )
    write_atomic(folder / "report.html", page.encode())


def _number(number: Number) -> dict[str, str | bool]:
    return {
        "meaning": number.meaning[:1].upper() + number.meaning[1:],
        "value": digits(number.value),
        "unit": "" if number.unit == "1" else number.unit,
        "interval": interval(number.ci_low, number.ci_high) or "none",
        "p": digits(number.p, 2),
        "named": number.named,
    }


def _remaining_facts(description: Description) -> list[tuple[str, str]]:
    """What the description leaves, in words; nothing where nothing is left."""
    structure = description.structure
    if structure is None:
        return []
    rows = zip(description.numbers, structure.moved.tolist(), structure.error.tolist(), strict=True)
    moved_facts = [(n.meaning.split(":")[0], step, error, "" if n.unit == "1" else n.unit) for n, step, error in rows]
    return discrepancy_facts(structure, moved_facts)


def _signature(signature: Signature) -> tuple[str, str, str, str, bool]:
    title = signature.title[:1].upper() + signature.title[1:]
    return (
        title,
        signature.unit,
        digits(signature.value),
        interval(signature.ci_low, signature.ci_high),
        signature.significant,
    )
