"""One thing that is wrong with the data of a measured unit."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pipeline.arrays import Index, Truth
from pipeline.constant_kinds import ShownCount
from pipeline.errors import InputError
from pipeline.identification.measurement.rows import Rows

Severity = Literal["fatal", "note"]

SHOWN_ROWS: ShownCount = 5
"""Rows that a fault names."""


@contextlib.contextmanager
def linear_algebra_faults(name: str) -> Iterator[None]:
    """Turn linear algebra that fails into a fault of the data; ``name`` is that of the unit.

    Raises
    ------
    InputError : an equation system is singular, or a decomposition does not converge.
    """
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise InputError(
            f"{name}: fault: undetermined: the data do not determine the numbers that are fitted to them ({error}); "
            "measure more torques, positions or cycles, and look for columns that repeat each other"
        ) from None


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong with the data.

    Attributes
    ----------
    kind : "missing column", "not a number", "decreasing time", "disordered rows", "constant column", "unit", "sign",
        "saturation", "clipped angle", "swapped columns", "missing cycle", "one sense", "too few points",
        "duplicate file", "encoder jump", "mixed offsets", "position stands out", "sense".
    message : what was found, and what to do.
    severity : "fatal" makes an identification impossible; "note" only bears on it.
    rows : `file:line` of the first rows concerned.
    count : rows concerned; 0 where it is not a matter of rows.
    """

    kind: str
    message: str
    severity: Severity
    rows: tuple[str, ...] = ()
    count: int = 0

    @property
    def line(self) -> str:
        """The fault in one line, with its rows."""
        remainder_text = f" and {self.count - len(self.rows)} more" if self.count > len(self.rows) else ""
        rows = f" ({', '.join(self.rows)}{remainder_text})" if self.rows else ""
        return f"{'fault' if self.severity == 'fatal' else 'note'}: {self.kind}: {self.message}{rows}"


def fault_of_rows(rows: Rows, selected_rows: Index | Truth, kind: str, severity: Severity, message: str) -> Fault:
    """A fault of some rows, a mask (n,) or their indices."""
    row_numbers = np.flatnonzero(selected_rows) if selected_rows.dtype == bool else selected_rows
    return Fault(kind, message, severity, rows.where(row_numbers[:SHOWN_ROWS]), len(row_numbers))


def frequent_fault(
    rows: Rows, is_faulty: Truth, kind: str, tolerated_share: float, text: str, advice: str
) -> Iterator[Fault]:
    """A fault of rows (n,), if there are any: fatal, with advice, where more than a share of all, else a note."""
    if is_faulty.any():
        is_fatal = is_faulty.mean() > tolerated_share
        message = f"{text}; {advice if is_fatal else 'these rows are left out'}"
        yield fault_of_rows(rows, is_faulty, kind, "fatal" if is_fatal else "note", message)
