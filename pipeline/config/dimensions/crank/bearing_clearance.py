"""Radial clearance of each disk's input bearing, besides the design's; of the cranks' bearings in it all alike."""

from pipeline.config.dimensions.dimension import Dimension

DIMENSION = Dimension(
    name="bearing_clearance",
    title="bearing clearance",
    sign="radial, besides the design's",
    meaning="radial clearance of the input bearing beyond the design's",
    rank=80,
    draw_columns=(2,),
    of_disk=True,
    one_sided=True,
    gap_sign=1,
)
