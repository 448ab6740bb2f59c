"""Eccentricity of each eccentric of each crank, besides that of its disk's eccentrics alike."""

from pipeline.config.dimensions.dimension import CRANKS, HOLES, Dimension

DIMENSION = Dimension(
    name="crank_eccentricity",
    title="eccentricity of each eccentric",
    sign="of each crank in each disk, beside what all cranks have; larger positive",
    meaning="eccentricity error of the eccentric of one crank, larger positive",
    rank=78,
    draw_columns=(142,),
    elements=HOLES,
    of_disk=True,
    need=CRANKS,
    size_um=lambda design: 1e3 * design.cycloid.eccentricity_mm,
    counted_where_varied=True,
    displaces=True,
)
