"""Dimensions of the output mechanism."""

from pipeline.config.dimensions.dimension import BUSHES, OUTPUT_PINS, PINS_IN_HOLES, ROLLERS, Dimension


# What makes a bush lie looser on its pin acts as a change of the roller's diameter.
def bush_fit(
    name: str, title: str, sign: str, meaning: str, rank: int, draw_columns: tuple[int], side: int
) -> Dimension:
    """A diameter between pin and bush; ``side``: +1 where larger makes the roller count larger, else -1."""
    return Dimension(
        name=name,
        title=title,
        sign=sign,
        meaning=f"{meaning}, larger positive; acts through the roller's diameter",
        rank=rank,
        draw_columns=draw_columns,
        elements=OUTPUT_PINS,
        need=BUSHES,
        measure="diameter",
        gap_sign=1 if side < 0 else -1,
        size_um=lambda design: 2e3 * design.output.seat_radius_mm,
        acts_on="roller_diameter",
        shift=lambda diameter, direction, design: side * diameter,
        counted_where_varied=True,
    )


DIMENSIONS = (
    # Diameter of each output roller, or of what lies in the disk's holes: output pins, or their bushes outside.
    Dimension(
        name="roller_diameter",
        title="output roller or pin diameter",
        sign="each output roller, pin or bush; smaller gives clearance",
        meaning="diameter error, larger positive",
        rank=70,
        draw_columns=(11,),
        elements=ROLLERS,
        measure="diameter",
        size_um=lambda design: 2e3 * design.output.contact_radius_mm,
        gap_sign=-1,
    ),
    # Position of each output pin in the flange, as a circular zone about its true place.
    Dimension(
        name="output_pin_position",
        title="position of output pins",
        sign="offset of each pin axis from its true position, at most half of the zone's diameter; direction random",
        meaning="offset of the output pin's axis from its true position; 0 of rollers",
        rank=72,
        draw_columns=(120, 121),
        elements=OUTPUT_PINS,
        need=PINS_IN_HOLES,
        one_sided=True,
        direction="direction of that offset in the flange's frame, counterclockwise from the crank at 0",
        zone=True,
        counted_where_varied=True,
    ),
    # Diameter of each output pin under its bush; without bushes the pin is what `roller_diameter` is of.
    bush_fit(
        "output_pin_diameter",
        title="output pin diameter under bushes",
        sign="each pin under its bush; smaller gives clearance",
        meaning="diameter error of the pin under its bush",
        rank=75,
        draw_columns=(125,),
        side=1,
    ),
    # Bore of each bush: larger, it lies looser on its pin, as with a smaller bush.
    bush_fit(
        "bush_bore",
        title="bore diameter of bushes",
        sign="each bush; larger gives clearance",
        meaning="error of the bush's bore diameter",
        rank=76,
        draw_columns=(126,),
        side=-1,
    ),
)
