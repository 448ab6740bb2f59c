"""What samples tell about a metric, with intervals: its distribution, its yield, and which error drives it."""

from pipeline.statistics.intervals import Estimate, distribution, pass_share
from pipeline.statistics.sensitivity import Indices, rank_correlation, variance_shares

__all__ = ["Estimate", "Indices", "distribution", "pass_share", "rank_correlation", "variance_shares"]
