"""Pins of three lobes."""

from pipeline.config.dimensions.pins._roundness import roundness

DIMENSION = roundness(3, "three-lobed", rank=34, draw_columns=(132, 133))
