"""Radial clearance of each crank's second support bearing, besides the design's."""

from pipeline.config.dimensions.dimension import CRANKSHAFTS, LOOSE_SUPPORTS, Dimension

DIMENSION = Dimension(
    name="second_support_clearance",
    title="clearance of the cranks' second supports",
    sign="radial, of each crank, besides the design's",
    meaning="radial clearance of the crank's second support bearing beyond the design's",
    rank=87,
    draw_columns=(151,),
    elements=CRANKSHAFTS,
    need=LOOSE_SUPPORTS,
    one_sided=True,
    counted_where_varied=True,
    displaces=True,
)
