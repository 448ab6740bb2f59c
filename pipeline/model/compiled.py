"""How the loops of this package are compiled: entry points, and the parts that they are made of.

Parts are always inlined into the entry points, which alone are cached on disk. A part that stayed a function would
exist twice, compiled by itself and within its caller, and which of the two runs would depend on whether the code
was compiled or read from the cache in this process: their sums may be ordered differently, so the last bits may differ.

The compiler's cache knows the file of the entry point alone: it stands in a folder named by the sources of the whole
package, so that a changed part is never left out.

Divisions are numpy's: by zero they give infinities. Python's, which raise, keep loops from being vectorised.
"""

from hashlib import sha256
from pathlib import Path

import numba
from numba import njit

PACKAGE = Path(__file__).parent
SOURCES = sha256(b"".join(path.read_bytes() for path in sorted(PACKAGE.rglob("*.py")))).hexdigest()[:12]
CACHE = Path(numba.config.CACHE_DIR or PACKAGE / "__pycache__") / f"compiled-{SOURCES}"  # type: ignore[attr-defined]
numba.config.CACHE_DIR = str(CACHE)  # type: ignore[attr-defined]

ALGEBRA = {"reassoc", "contract", "nsz", "arcp"}
"""What the compiler may assume of sums and products where their order is ours to choose; not that all is finite."""

COMPILED = {"nogil": True, "error_model": "numpy"}
INLINED = {"forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, **COMPILED}
"""Parts are called by compiled code alone: doors for Python would take a third of the compiler's time."""
BORROWED = {"_nrt": False}
"""Code that allocates nothing and counts no references: every view of an array would cost two atomic operations."""

part = njit(**INLINED)  # type: ignore[call-overload]
entry = njit(cache=True, **COMPILED)  # type: ignore[call-overload]
algebraic_part = njit(fastmath=ALGEBRA, **INLINED, **BORROWED)  # type: ignore[call-overload]
borrowing_entry = njit(cache=True, **COMPILED, **BORROWED)  # type: ignore[call-overload]
