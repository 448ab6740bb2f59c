"""Position of each of a disk's holes against its bore, as a circular zone about its true place."""

from pipeline.config.dimensions.dimension import HOLED, HOLES, Dimension

DIMENSION = Dimension(
    name="hole_position",
    title="position of holes in the disk",
    sign="offset of each hole axis from its true position, at most half of the zone's diameter; direction random",
    meaning="offset of the hole's axis from its true position",
    rank=73,
    draw_columns=(122, 123),
    elements=HOLES,
    of_disk=True,
    need=HOLED,
    one_sided=True,
    direction="direction of that offset in the disk's frame, counterclockwise from the crank at 0",
    zone=True,
    counted_where_varied=True,
)
