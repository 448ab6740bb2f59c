"""What samples tell about a metric, with intervals: its distribution, its yield, and which error drives it."""

from pipeline.statistics.intervals import Estimate, distribution, pass_share
from pipeline.statistics.sensitivity import RANK_CORRELATION, Indices, rank_correlation
from pipeline.statistics.variance_indices import (
    FIRST_ORDER,
    SUM,
    TOTAL,
    are_determined,
    two_fidelity_indices,
    variance_indices,
)

__all__ = [
    "FIRST_ORDER",
    "RANK_CORRELATION",
    "SUM",
    "TOTAL",
    "Estimate",
    "Indices",
    "are_determined",
    "distribution",
    "pass_share",
    "rank_correlation",
    "two_fidelity_indices",
    "variance_indices",
]
