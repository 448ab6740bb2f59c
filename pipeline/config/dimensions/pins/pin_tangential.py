"""Tangential position of each pin."""

from pipeline.config.dimensions.dimension import PINS, Dimension

DIMENSION = Dimension(
    name="pin_tangential",
    title="tangential pin position",
    sign="each pin; counterclockwise positive",
    meaning="position error counterclockwise",
    rank=20,
    draw_columns=(8,),
    elements=PINS,
)
