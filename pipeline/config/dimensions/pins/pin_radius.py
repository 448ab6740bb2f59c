"""Radius of each pin."""

from pipeline.config.dimensions.dimension import PINS, Dimension

DIMENSION = Dimension(
    name="pin_radius",
    title="pin radius",
    sign="each pin; smaller gives clearance",
    meaning="radius error, larger positive",
    rank=30,
    draw_columns=(9,),
    elements=PINS,
    measure="radius",
    size_um=lambda design: 1e3 * design.cycloid.pin_radius_mm,
    gap_sign=-1,
)
