"""Numbers and units as the pages on measured units print them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from pipeline.identification.identify import Identification
from pipeline.identification.selection.statements.remainder import Remainder
from pipeline.identification.selection.statements.verdict import UNEXPLAINED
from pipeline.report.layout import DASH

SMALLEST_P = 1e-3
"""Below it the page says so: the resamples tell no smaller one."""


def digits(value: float | None, figures: int = 3) -> str:
    """A number with three significant digits; an en dash for none."""
    if value is None or not math.isfinite(value):
        return DASH
    if value == 0:
        return "0"
    places = max(figures - 1 - math.floor(math.log10(abs(value))), 0)
    text = f"{value:,.{places}f}" if places <= 6 else f"{value:.{figures - 1}e}"
    return text.replace("-", "\u2212")


def interval(low: float | None, high: float | None) -> str:
    """Two ends; empty without one of them."""
    ends = digits(low), digits(high)
    return "" if DASH in ends else f"{ends[0]} to {ends[1]}"


def p_value(value: float) -> str:
    """A p-value, or that it is less than any that is told apart."""
    return DASH if not math.isfinite(value) else f"< {SMALLEST_P:g}" if value < SMALLEST_P else f"{value:.3f}"


def with_capital(text: str) -> str:
    """The text with a capital first letter."""
    return text[:1].upper() + text[1:]


def shown_unit(text: str) -> str:
    """A unit as it is printed; nothing for a pure number."""
    return "" if text == "1" else text.replace("um", "µm")


def remainder_cards(identification: Identification) -> list[tuple[str, str, str, str]]:
    """Cards of what the nearest effects leave that are not named: the share removed, and the rest beside noise."""
    if identification.verdict.verdict != UNEXPLAINED or not identification.selection.best_model:
        return []
    remainder, floor = identification.remainder, identification.remainder.noise_arcmin
    title, best_error = min(identification.baselines.items(), key=lambda item: item[1].to_noise)
    size = remainder.scatter.size if remainder.scatter else math.nan
    return [
        ("By the nearest", f"{remainder.removed:.0%}", "", "of the refitted model's held-out error is removed"),
        ("Not traced", digits(remainder.rms_arcmin), "arcmin", f"beside a noise floor of {digits(floor)} arcmin"),
        ("Of it alike everywhere", digits(remainder.common_arcmin), "arcmin", "common to all positions"),
        ("Of it by position", digits(size), "arcmin", scatter_words(remainder)),
        ("Best without a reducer", digits(best_error.rms_arcmin), "arcmin", title),
    ]


def scatter_words(remainder: Remainder) -> str:
    """How sure the scatter between positions is."""
    scatter = remainder.scatter
    if scatter is None:
        return "one position: not known apart"
    limits = interval(scatter.ci_low, scatter.ci_high)
    return f"scatter between {scatter.groups} positions, 95 % interval {limits}"


def written_facts(verdict: Mapping[str, Any]) -> tuple[str, str, str] | None:
    """Name of the written study, what it leaves of the measured angles [arcmin], and what its fit does."""
    written_study = verdict["written"]
    if written_study is None:
        return None
    return written_study["study"], digits(written_study["rms_arcmin"]), digits(written_study["fit_rms_arcmin"])
