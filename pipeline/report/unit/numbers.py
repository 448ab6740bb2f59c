"""Numbers and units as the pages on measured units print them."""

from __future__ import annotations

import math

from pipeline.report.layout.wording import DASH

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
