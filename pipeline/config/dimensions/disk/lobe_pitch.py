"""Pitch error of each lobe: how far it was indexed around the disk from its nominal direction."""

from pipeline.config.dimensions.dimension import LOBES, Dimension

DIMENSION = Dimension(
    name="lobe_pitch",
    title="lobe pitch (each lobe)",
    sign="each lobe around the disk's axis, along the circle at half of the lobes' height; counterclockwise positive",
    meaning="way of this lobe around the disk's axis at half of the lobes' height, counterclockwise positive",
    rank=55,
    draw_columns=(100,),
    of_disk=True,
    elements=LOBES,
    counted_where_varied=True,
)
