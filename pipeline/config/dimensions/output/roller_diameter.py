"""Diameter of each output roller, or of what lies in the disk's holes: output pins, or their bushes outside."""

from pipeline.config.dimensions.dimension import ROLLERS, Dimension

DIMENSION = Dimension(
    name="roller_diameter",
    title="output roller or pin diameter",
    sign="each output roller, pin or bush; smaller gives clearance",
    meaning="diameter error, larger positive",
    rank=70,
    draw_columns=(11,),
    elements=ROLLERS,
    measure="diameter",
    size_um=lambda design: 2e3 * design.output.contact_radius_mm,
    gap_sign=-1,
)
