"""A pin circle of two lobes."""

from pipeline.config.dimensions.pins._ovality import ovality

DIMENSION = ovality(2, "two-lobed", rank=90, draw_columns=(3, 5))
