"""Profile of each lobe, besides the disk's."""

from pipeline.config.dimensions.dimension import LOBES, Dimension

DIMENSION = Dimension(
    name="lobe_profile",
    title="lobe profile (each lobe)",
    sign="material off each lobe besides; positive gives clearance",
    meaning="material off this lobe's flank besides disk_profile_um",
    rank=50,
    draw_columns=(10,),
    of_disk=True,
    elements=LOBES,
    gap_sign=1,
    drawing_sign=-1,
)
