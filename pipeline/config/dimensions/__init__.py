"""The toleranced dimensions of a reducer, in a table for each part that has them.

A table is the tuple ``DIMENSIONS`` of a file; adding one is adding an entry, or a file with one ``DIMENSION``: its
tolerance in a study, its value in a case, its draw, its column in the tables, its share among the drivers and its
words in the report follow from it. One that acts through another one (``shift``) needs nothing else; one that changes
a gap in a way of its own also needs that gap.
"""

from pipeline.config.dimensions.dimension import Dimension, Elements, dimension_library

__all__ = ["Dimension", "Elements", "dimension_library"]
