"""Teeth of each planet against the eccentrics of its crank, along the pitch circle."""

from pipeline.config.dimensions.dimension import CRANKS, CRANKSHAFTS, Dimension

DIMENSION = Dimension(
    name="planet_timing",
    title="timing of planets",
    sign="way of each planet's teeth along its pitch circle against the eccentrics; counterclockwise positive",
    meaning="way of the planet's teeth along its pitch circle, counterclockwise positive",
    rank=83,
    draw_columns=(146,),
    elements=CRANKSHAFTS,
    need=CRANKS,
    counted_where_varied=True,
    displaces=True,
)
