"""Manufacturing errors of any sample of a study, counted and not consumed. Arrays have the sample axis first."""

from pipeline.sampling.designs import replicates
from pipeline.sampling.errors import Errors, draw, oval_shift

__all__ = ["Errors", "draw", "oval_shift", "replicates"]
