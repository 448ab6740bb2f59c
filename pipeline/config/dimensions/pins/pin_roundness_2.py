"""Pins of two lobes."""

from pipeline.config.dimensions.pins._roundness import roundness

DIMENSION = roundness(2, "two-lobed", rank=32, drawn=(130, 131))
