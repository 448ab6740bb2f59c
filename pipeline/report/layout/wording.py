"""Numbers as the report writes them: their digits, their intervals, and what the samples do not determine."""

import math
from collections.abc import Sequence

from pipeline.model.metrics import Quantity, signed_number

DASH = "\u2013"
"""En dash: no value, or an end of an interval that the samples do not determine."""
UNDETERMINED_TEXT = "not determined"

SHARE = Quantity("Share of units", "%", 1)
FINEST_SHARE = 4
"""Decimals of a share in percent at most: parts per million."""


def number(value: float, quantity: Quantity) -> str:
    """The value with the quantity's digits; an en dash for none."""
    return quantity.text(value) if math.isfinite(value) else DASH


def interval(low: float, high: float, quantity: Quantity) -> str:
    """A confidence interval; an en dash stands for an undetermined end."""
    if not (math.isfinite(low) or math.isfinite(high)):
        return UNDETERMINED_TEXT
    return f"{number(low, quantity)} to {number(high, quantity)}"


def percent(share: float) -> str:
    """A share in percent, with its sign."""
    return f"{_percentage(share)} %" if math.isfinite(share) else DASH


def _percentage(share: float) -> str:
    """A share in percent without its sign; one that is neither 0 nor 1 is not rounded to either."""
    decimals = SHARE.decimals
    while 0 < share < 1 and round(100 * share, decimals) in (0, 100) and decimals < FINEST_SHARE:
        decimals += 1
    return SHARE.text(100 * share) if decimals == SHARE.decimals else signed_number(100 * share, decimals)


def percent_interval(low: float, high: float) -> str:
    """A confidence interval of a share in percent."""
    if not (math.isfinite(low) or math.isfinite(high)):
        return UNDETERMINED_TEXT
    return f"{' to '.join(_percentage(end) if math.isfinite(end) else DASH for end in (low, high))} %"


def plain_number(value: float | int) -> str:
    """A setting as it was typed, with grouped digits."""
    return f"{value:,.10g}".replace("-", "\u2212")


def rounded_number(value: float) -> str:
    """A number with three significant digits and grouped thousands; an en dash for none."""
    return plain_number(float(f"{value:.3g}")) if math.isfinite(value) else DASH


def count_text(count: int, singular: str, plural: str | None = None) -> str:
    """``1 sample``, ``2,000 samples``."""
    return f"{count:,} {singular if count == 1 else plural or singular + 's'}"


def listed_text(texts: Sequence[str], conjunction: str = "and") -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} {conjunction} {texts[-1]}" if texts else DASH
