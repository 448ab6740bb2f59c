"""What the page says beside the verdict: cards of what claimed effects leave, and what the written study leaves."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from pipeline.identification.identify import Identification
from pipeline.identification.selection.verdict import MOSTLY
from pipeline.report.unit.numbers import digits


def remainder_cards(found: Identification) -> list[tuple[str, str, str, str]]:
    """Cards of what claimed effects leave: how much is removed, and the rest beside noise, positions and baselines."""
    if found.verdict.verdict != MOSTLY:
        return []
    rest, floor = found.remainder, found.remainder.noise_arcmin
    title, best = min(found.baselines.items(), key=lambda item: item[1].to_noise)
    scatter_text = (
        "from position to position" if math.isfinite(rest.by_position_arcmin) else "one position: not known apart"
    )
    return [
        ("Explained", f"{rest.removed:.0%}", "", "of the refitted model's held-out error is removed"),
        ("Not traced", digits(rest.rms_arcmin), "arcmin", f"beside a noise floor of {digits(floor)} arcmin"),
        ("Of it alike everywhere", digits(rest.common_arcmin), "arcmin", "common to all positions"),
        ("Of it by position", digits(rest.by_position_arcmin), "arcmin", scatter_text),
        ("Best without a reducer", digits(best.rms_arcmin), "arcmin", title),
    ]


def written_facts(verdict: Mapping[str, Any]) -> tuple[str, str] | None:
    """Name of the written study, and what it leaves of the measured angles [arcmin]."""
    written = verdict["written"]
    return None if written is None else (written["study"], digits(written["rms_arcmin"]))
