"""Run-out of each planet on its crank, as the eccentricity of its pitch circle."""

from pipeline.config.dimensions.dimension import CRANKS, CRANKSHAFTS, Dimension

DIMENSION = Dimension(
    name="planet_runout",
    title="run-out of planets",
    sign="way of the pitch circle's centre from the crank's axis, half of an indicator's reading; direction random",
    meaning="way of the planet's pitch circle from the crank's axis, half of an indicator's reading",
    rank=82,
    draw_columns=(144, 145),
    elements=CRANKSHAFTS,
    need=CRANKS,
    one_sided=True,
    direction="direction of that way, counterclockwise from the crank at 0; it turns with the crank",
    counted_where_varied=True,
    displaces=True,
)
