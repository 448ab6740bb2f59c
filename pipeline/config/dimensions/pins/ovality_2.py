"""A pin circle of two lobes."""

from pipeline.config.dimensions.pins._ovality import ovality

DIMENSION = ovality(2, "two-lobed", rank=90, drawn=(3, 5))
