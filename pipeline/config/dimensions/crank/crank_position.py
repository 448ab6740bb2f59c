"""Position of each crank's axis in the carrier, as a circular zone about its true place."""

from pipeline.config.dimensions.dimension import CRANKS, CRANKSHAFTS, Dimension

DIMENSION = Dimension(
    name="crank_position",
    title="position of cranks in the carrier",
    sign="way of each crank's axis from its true place, at most half of the zone's diameter; direction random",
    meaning="way of the crank's axis from its true place",
    rank=77,
    draw_columns=(140, 141),
    elements=CRANKSHAFTS,
    need=CRANKS,
    one_sided=True,
    direction="direction of that way in the carrier's frame, counterclockwise from the crank at 0",
    zone=True,
    counted_where_varied=True,
    displaces=True,
)
