"""Diameter of each output pin under its bush; without bushes the pin is what `roller_diameter` is of."""

from pipeline.config.dimensions.dimension import BUSHES, OUTPUT_PINS, Dimension

DIMENSION = Dimension(
    name="output_pin_diameter",
    title="output pin diameter under bushes",
    sign="each pin under its bush; smaller gives clearance",
    meaning="diameter error of the pin under its bush, larger positive; acts through the roller's diameter",
    rank=75,
    drawn=(125,),
    elements=OUTPUT_PINS,
    need=BUSHES,
    measure="diameter",
    size_um=lambda design: 2e3 * design.output.seat_radius_mm,
    acts_on="roller_diameter",
    shift=lambda diameter, direction, design: diameter,
    counted_where_varied=True,
)
