"""Diameter of each output roller, or of each output pin in the disk's holes."""

from pipeline.config.dimensions.dimension import ROLLERS, Dimension

DIMENSION = Dimension(
    name="roller_diameter",
    title="output roller or pin diameter",
    sign="each output roller or pin; smaller gives clearance",
    meaning="diameter error, larger positive",
    rank=70,
    drawn=(11,),
    elements=ROLLERS,
    measure="diameter",
    size_um=lambda design: 2e3 * design.output.contact_radius_mm,
)
