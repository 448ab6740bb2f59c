"""A pin circle of three lobes."""

from pipeline.config.dimensions.pins._ovality import ovality

DIMENSION = ovality(3, "three-lobed", rank=100, drawn=(4, 6))
