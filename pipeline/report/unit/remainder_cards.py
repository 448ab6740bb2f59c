"""What the page says beside the verdict: cards of what claimed effects leave, and what the written study leaves."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from pipeline.identification.identify import Identification
from pipeline.identification.selection.statements.verdict import MOSTLY
from pipeline.report.unit.numbers import digits


def remainder_cards(identification: Identification) -> list[tuple[str, str, str, str]]:
    """Cards of what claimed effects leave: how much is removed, and the rest beside noise, positions and baselines."""
    if identification.verdict.verdict != MOSTLY:
        return []
    remainder, floor = identification.remainder, identification.remainder.noise_arcmin
    title, best = min(identification.baselines.items(), key=lambda item: item[1].to_noise)
    scatter_text = (
        "from position to position" if math.isfinite(remainder.by_position_arcmin) else "one position: not known apart"
    )
    return [
        ("Explained", f"{remainder.removed:.0%}", "", "of the refitted model's held-out error is removed"),
        ("Not traced", digits(remainder.rms_arcmin), "arcmin", f"beside a noise floor of {digits(floor)} arcmin"),
        ("Of it alike everywhere", digits(remainder.common_arcmin), "arcmin", "common to all positions"),
        ("Of it by position", digits(remainder.by_position_arcmin), "arcmin", scatter_text),
        ("Best without a reducer", digits(best.rms_arcmin), "arcmin", title),
    ]


def written_facts(verdict: Mapping[str, Any]) -> tuple[str, str] | None:
    """Name of the written study, and what it leaves of the measured angles [arcmin]."""
    written_verdict = verdict["written"]
    return None if written_verdict is None else (written_verdict["study"], digits(written_verdict["rms_arcmin"]))
