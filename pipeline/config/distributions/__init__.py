"""How a deviation is distributed between its limits, one file each.

A file defines ``DISTRIBUTION``, the class of its settings; adding one is adding a file: a study's tolerance may name
it, its values are checked, drawn and told in the report by what the class says.
"""

from pipeline.config.distributions.distribution import Distribution, Spread, library

__all__ = ["Distribution", "Spread", "library"]
