"""Radial clearance of each bearing of a crank in a disk, besides the design's and its disk's."""

from pipeline.config.dimensions.dimension import CRANKS, HOLES, Dimension

DIMENSION = Dimension(
    name="crank_bearing_clearance",
    title="clearance of each crank bearing",
    sign="radial, of each crank in each disk, besides the design's",
    meaning="radial clearance of the bearing of one crank beyond the design's; acts through the hole's diameter",
    rank=81,
    draw_columns=(127,),
    elements=HOLES,
    of_disk=True,
    one_sided=True,
    need=CRANKS,
    acts_on="hole_diameter",
    shift=lambda clearance, direction, design: 2 * clearance,
    counted_where_varied=True,
    gap_sign=1,
)
