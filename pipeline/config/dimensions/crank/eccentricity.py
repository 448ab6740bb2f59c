"""Eccentricity of the crank."""

from pipeline.config.dimensions.dimension import Dimension

DIMENSION = Dimension(
    name="eccentricity",
    title="eccentricity",
    sign="larger positive",
    meaning="eccentricity error, larger positive",
    rank=60,
    draw_columns=(0,),
    of_disk=True,
    size_um=lambda design: 1e3 * design.cycloid.eccentricity_mm,
)
