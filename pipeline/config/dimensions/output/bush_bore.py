"""Bore of each bush: larger, it lies looser on its pin, as with a smaller bush."""

from pipeline.config.dimensions.dimension import BUSHES, OUTPUT_PINS, Dimension

DIMENSION = Dimension(
    name="bush_bore",
    title="bore diameter of bushes",
    sign="each bush; larger gives clearance",
    meaning="error of the bush's bore diameter, larger positive; acts through the roller's diameter",
    rank=76,
    drawn=(126,),
    elements=OUTPUT_PINS,
    need=BUSHES,
    measure="diameter",
    size_um=lambda design: 2e3 * design.output.seat_radius_mm,
    acts_on="roller_diameter",
    shift=lambda diameter, direction, design: -diameter,
    counted_where_varied=True,
)
