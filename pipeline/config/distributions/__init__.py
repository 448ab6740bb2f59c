"""How a deviation is distributed between its limits, in a table.

The table is the tuple ``DISTRIBUTIONS`` of a file; adding one is adding an entry, the class of its settings, or a file
with one ``DISTRIBUTION``: a study's tolerance may name it, its values are checked, drawn and told in the report by
what the class says.
"""

from pipeline.config.distributions.distribution import Distribution, Spread, library

__all__ = ["Distribution", "Spread", "library"]
