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
    reference, computed : the two numbers [of the quantity's unit]; of arrays, the entries that differ most.
    error : their difference, absolute or relative as the quantity says.
    limit : largest error allowed; None for a number that is only stated.
    skipped : whether the check could not be made on this machine.
    """

    quantity: str
    reference: float
    computed: float
    error: float
    limit: float | None
    skipped: bool = False

    @property
    def ok(self) -> bool | None:
        """Whether the error keeps the limit; None if the check was skipped. NaN keeps no limit."""
        if self.skipped:
            return None
        return self.limit is None or bool(self.error <= self.limit)


Check = Callable[[Specimen], Iterator[Finding]]


def compared(quantity: str, reference: ArrayLike, computed: ArrayLike, limit: float, scale: Any = 1.0) -> Finding:
    """The entries that differ most; the error is their difference over ``scale`` (a number or one per entry)."""
    reference, computed, scale = np.broadcast_arrays(np.asarray(reference, float), computed, scale)
    error = np.abs(computed - reference) / np.abs(scale)
    worst = int(np.argmax(np.where(np.isnan(error), np.inf, error)))
    return Finding(quantity, float(reference.flat[worst]), float(computed.flat[worst]), float(error.flat[worst]), limit)


def relative(quantity: str, reference: ArrayLike, computed: ArrayLike, limit: float) -> Finding:
    """The entries that differ most in proportion to the reference."""
    return compared(quantity, reference, computed, limit, scale=reference)


def vanishing(quantity: str, computed: ArrayLike, limit: float) -> Finding:
    """The largest magnitude of what must be zero."""
    return compared(quantity, 0.0, computed, limit)


def at_least(quantity: str, bound: float, computed: ArrayLike) -> Finding:
    """The smallest value of what must not fall below ``bound``; the error is what it lacks."""
    smallest = float(np.min(computed))
    return Finding(quantity, bound, smallest, max(0.0, bound - smallest), 0.0)


def positive(quantity: str, computed: ArrayLike) -> Finding:
    """The smallest value of what must be positive."""
    return at_least(quantity, float(np.finfo(float).tiny), computed)


def stated(quantity: str, value: float, reference: float = np.nan) -> Finding:
    """A number that is reported and judged by nothing."""
    return Finding(quantity, reference, value, np.nan, None)


def skipped(quantity: str) -> Finding:
    """A check that this machine cannot make; ``quantity`` says what it lacks."""
    return Finding(quantity, np.nan, np.nan, np.nan, None, skipped=True)
