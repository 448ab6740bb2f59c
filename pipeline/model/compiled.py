"""How the loops of this package are compiled: entry points, and the parts that they are made of.

Parts are always inlined into the entry points, which alone are cached on disk. A part that stayed a function would
exist twice, compiled by itself and within its caller, and which of the two runs would depend on whether the code
was compiled or read from the cache in this process: their sums may be ordered differently, so the last bits may differ.
"""

from numba import njit

ALGEBRA = {"reassoc", "contract", "nsz", "arcp"}
"""What the compiler may assume of sums and products where their order is ours to choose; not that all is finite."""

part = njit(nogil=True, forceinline=True)
entry = njit(nogil=True, cache=True)
algebraic_part = njit(nogil=True, forceinline=True, fastmath=ALGEBRA)
