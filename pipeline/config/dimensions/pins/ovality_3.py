"""A pin circle of three lobes."""

from pipeline.config.dimensions.pins._ovality import ovality

DIMENSION = ovality(3, "three-lobed", rank=100, draw_columns=(4, 6))
