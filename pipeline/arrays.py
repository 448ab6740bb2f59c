"""Arrays by the kind of their elements. Shapes and units are in the docstrings of the functions that take them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]
Single = NDArray[np.float32]
Complex = NDArray[np.complex128]
Whole = NDArray[np.int64]
Index = NDArray[np.intp]
Truth = NDArray[np.bool_]


def joined_columns(parts: Sequence[Mapping[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    """Columns (n_rows,) or (n_rows, n) of tables, one table below the other."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
