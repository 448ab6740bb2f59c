"""Arrays by the kind of their elements. Shapes and units are in the docstrings of the functions that take them."""

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]
Single = NDArray[np.float32]
Complex = NDArray[np.complex128]
Whole = NDArray[np.int64]
Index = NDArray[np.intp]
Truth = NDArray[np.bool_]
