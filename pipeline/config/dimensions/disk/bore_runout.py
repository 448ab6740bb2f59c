"""Run-out of the disk's bore against its flank, as the eccentricity of the flank's centre; it turns with the disk."""

from pipeline.config.dimensions.dimension import Dimension

DIMENSION = Dimension(
    name="bore_runout",
    title="run-out of bore against flank",
    sign="way of the flank's centre from the bore's, half of an indicator's reading; direction random",
    meaning="way of the flank's centre from the bore's, half of an indicator's reading",
    rank=66,
    draw_columns=(110, 111),
    most_disks=1,
    one_sided=True,
    direction="direction of the flank's centre from the bore's in the disk's frame",
    counted_where_varied=True,
)
