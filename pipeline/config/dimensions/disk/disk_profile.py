"""Size of the disk: material off its whole flank."""

from pipeline.config.dimensions.dimension import Dimension

DIMENSION = Dimension(
    name="disk_profile",
    title="disk profile (whole disk)",
    sign="material off the whole flank; positive gives clearance",
    meaning="material off the whole flank, as the study reads it",
    rank=40,
    draw_columns=(1,),
    of_disk=True,
    gap_sign=1,
    drawing_sign=-1,
)
