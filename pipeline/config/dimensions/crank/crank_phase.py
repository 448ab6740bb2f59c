"""Direction of each eccentric of each crank, as the way of its centre around the crank's axis."""

from pipeline.config.dimensions.dimension import CRANKS, HOLES, Dimension

DIMENSION = Dimension(
    name="crank_phase",
    title="phase of each eccentric",
    sign="way of the centre of each eccentric around its crank; counterclockwise positive",
    meaning="way of the centre of one crank's eccentric around the crank, counterclockwise positive",
    rank=79,
    draw_columns=(143,),
    elements=HOLES,
    of_disk=True,
    need=CRANKS,
    counted_where_varied=True,
    displaces=True,
)
