"""Diameter of each of a disk's holes, in which an output pin or its bush lies."""

from pipeline.config.dimensions.dimension import HOLES, PINS_IN_HOLES, Dimension

DIMENSION = Dimension(
    name="hole_diameter",
    title="hole diameter",
    sign="each hole of the disk; larger gives clearance",
    meaning="diameter error, larger positive",
    rank=74,
    draw_columns=(124,),
    elements=HOLES,
    of_disk=True,
    need=PINS_IN_HOLES,
    measure="diameter",
    size_um=lambda design: 2e3 * design.output.hole_radius(design.cycloid.eccentricity_mm),
    counted_where_varied=True,
    gap_sign=1,
)
