"""How many independent units know a yield as well as is wanted."""

import math

import scipy  # its functions are slow to import: they are when they are called

GROWTH = 4
"""Times as many samples that a batch asks for at most: the share of few units may mislead, and looks are to be few."""


def units_for_yield(share: float, half_width: float, confidence: float) -> int:
    """Fewest units whose Clopper-Pearson interval of a share, at the share itself, is at most 2 ``half_width`` wide.

    Parameters
    ----------
    share : in [0, 1].
    half_width : in (0, 0.5].
    confidence : level of the interval, in (0, 1).

    Raises
    ------
    ValueError
        If a number lies outside of its range.

    Notes
    -----
    About z^2 share (1 - share)/half_width^2; at a share of 1 the interval is one-sided, ln(tail)/ln(1 - width).
    """
    if not (0 <= share <= 1 and 0 < half_width <= 0.5 and 0 < confidence < 1):
        raise ValueError(f"share {share}, half width {half_width}, confidence {confidence}: outside of their ranges")
    low, high = 1, 2
    while _width(share, high, confidence) > 2 * half_width:
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if _width(share, middle, confidence) <= 2 * half_width else (middle, high)
    return high


def next_units(share: float, units: int, samples: int, half_width: float, confidence: float) -> int:
    """Samples after which a yield may be known as well as is wanted, when ``samples`` of them did not do.

    Parameters
    ----------
    share : yield of the ``units`` among the samples that have a result.
    half_width, confidence : as in ``units_for_yield``.

    Notes
    -----
    What the share so far says, in proportion where samples have no result; `GROWTH` times as many at most, and one more
    at least.
    """
    target_units = units_for_yield(share, half_width, confidence) * samples / max(units, 1)
    return max(samples + 1, min(GROWTH * samples, math.ceil(target_units)))


def _width(share: float, units: int, confidence: float) -> float:
    """Width of the interval of ``units`` with the share; a count need not be a whole number."""
    tail, n_passes = (1 - confidence) / 2, share * units
    low = 0.0 if n_passes <= 0 else float(scipy.special.betaincinv(n_passes, units - n_passes + 1, tail))
    high = (
        1.0 if math.isclose(n_passes, units) else float(scipy.special.betainccinv(n_passes + 1, units - n_passes, tail))
    )
    return high - low
