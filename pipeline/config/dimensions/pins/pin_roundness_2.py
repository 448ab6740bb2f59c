"""Pins of two lobes."""

from pipeline.config.dimensions.pins._roundness import roundness

DIMENSION = roundness(2, "two-lobed", rank=32, draw_columns=(130, 131))
