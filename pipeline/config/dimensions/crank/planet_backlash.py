"""Backlash of each planet with the sun along the pitch circle, beside the design's."""

from pipeline.config.dimensions.dimension import CRANKS, CRANKSHAFTS, Dimension

DIMENSION = Dimension(
    name="planet_backlash",
    title="backlash of planets",
    sign="way of each planet from flank to flank, beside the design's; larger gives clearance",
    meaning="way of the planet from flank to flank along the pitch circle beyond the design's",
    rank=84,
    draw_columns=(147,),
    elements=CRANKSHAFTS,
    need=CRANKS,
    counted_where_varied=True,
    displaces=True,
)
