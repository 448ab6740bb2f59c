"""Radial clearance of each crank's first support bearing, besides the design's."""

from pipeline.config.dimensions.dimension import CRANKSHAFTS, LOOSE_SUPPORTS, Dimension

DIMENSION = Dimension(
    name="first_support_clearance",
    title="clearance of the cranks' first supports",
    sign="radial, of each crank, besides the design's",
    meaning="radial clearance of the crank's first support bearing beyond the design's",
    rank=86,
    draw_columns=(150,),
    elements=CRANKSHAFTS,
    need=LOOSE_SUPPORTS,
    one_sided=True,
    counted_where_varied=True,
    displaces=True,
)
