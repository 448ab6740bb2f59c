"""Direction of each eccentric on the crank, as the way of its centre around the crank's axis."""

from pipeline.config.dimensions.dimension import Dimension

DIMENSION = Dimension(
    name="eccentric_phase",
    title="phase of eccentric",
    sign="way of each eccentric's centre around the crank; counterclockwise positive",
    meaning="way of the eccentric's centre around the crank, counterclockwise positive",
    rank=65,
    draw_columns=(90,),
    of_disk=True,
    fewest_disks=2,
)
