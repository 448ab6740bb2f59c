"""Position of each output pin in the flange, as a circular zone about its true place."""

from pipeline.config.dimensions.dimension import OUTPUT_PINS, PINS_IN_HOLES, Dimension

DIMENSION = Dimension(
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
)
