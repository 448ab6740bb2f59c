"""Radial position of each pin."""

from pipeline.config.dimensions.dimension import PINS, Dimension

DIMENSION = Dimension(
    name="pin_radial",
    title="radial pin position",
    sign="each pin; outwards positive",
    meaning="position error outwards, ovalities included",
    rank=10,
    draw_columns=(7,),
    elements=PINS,
    gap_sign=1,
)
