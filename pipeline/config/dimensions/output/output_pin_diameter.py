"""Diameter of each output pin under its bush; without bushes the pin is what `roller_diameter` is of."""

from pipeline.config.dimensions.output._bush_fit import bush_fit

DIMENSION = bush_fit(
    "output_pin_diameter",
    title="output pin diameter under bushes",
    sign="each pin under its bush; smaller gives clearance",
    meaning="diameter error of the pin under its bush",
    rank=75,
    draw_columns=(125,),
    side=1,
)
