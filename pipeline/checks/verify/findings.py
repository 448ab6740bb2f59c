"""What a check finds: a computed number beside its reference, the error, and the limit that it must keep."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipeline.checks.specimen import Specimen


@dataclass(frozen=True)
class Finding:
    """One number of a check.

    Attributes
    ----------
    quantity : what is compared, with its unit.
    reference, computed_value : the two numbers [of the quantity's unit]; of arrays, the entries that differ most.
    error : their difference, absolute or relative as the quantity says.
    limit : largest error allowed; None for a number that is only stated.
    is_skipped : whether the check could not be made on this machine.
    """

    quantity: str
    reference: float
    computed_value: float
    error: float
    limit: float | None
    is_skipped: bool = False

    @property
    def ok(self) -> bool | None:
        """Whether the error keeps the limit; None if the check was skipped. NaN keeps no limit."""
        if self.is_skipped:
            return None
        return self.limit is None or bool(self.error <= self.limit)


Check = Callable[[Specimen], Iterator[Finding]]


def largest_difference(
    quantity: str, reference: ArrayLike, computed_values: ArrayLike, limit: float, scale: Any = 1.0
) -> Finding:
    """The entries that differ most; the error is their difference over ``scale`` (a number or one per entry)."""
    reference, computed_values, scale = np.broadcast_arrays(np.asarray(reference, float), computed_values, scale)
    error = np.abs(computed_values - reference) / np.abs(scale)
    worst_entry = int(np.argmax(np.where(np.isnan(error), np.inf, error)))
    return Finding(
        quantity,
        float(reference.flat[worst_entry]),
        float(computed_values.flat[worst_entry]),
        float(error.flat[worst_entry]),
        limit,
    )


def relative(quantity: str, reference: ArrayLike, computed_values: ArrayLike, limit: float) -> Finding:
    """The entries that differ most in proportion to the reference."""
    return largest_difference(quantity, reference, computed_values, limit, scale=reference)


def vanishing(quantity: str, computed_values: ArrayLike, limit: float) -> Finding:
    """The largest magnitude of what must be zero."""
    return largest_difference(quantity, 0.0, computed_values, limit)


def at_least(quantity: str, bound: float, computed_values: ArrayLike) -> Finding:
    """The smallest value of what must not fall below ``bound``; the error is what it lacks."""
    smallest_value = float(np.min(computed_values))
    return Finding(quantity, bound, smallest_value, max(0.0, bound - smallest_value), 0.0)


def positive(quantity: str, computed_values: ArrayLike) -> Finding:
    """The smallest value of what must be positive."""
    return at_least(quantity, float(np.finfo(float).tiny), computed_values)


def reported_number(quantity: str, value: float, reference: float = np.nan) -> Finding:
    """A number that is reported and judged by nothing."""
    return Finding(quantity, reference, value, np.nan, None)


def skipped_check(quantity: str) -> Finding:
    """A check that this machine cannot make; ``quantity`` says what it lacks."""
    return Finding(quantity, np.nan, np.nan, np.nan, None, is_skipped=True)
