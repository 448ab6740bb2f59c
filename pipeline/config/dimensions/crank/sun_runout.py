"""Run-out of the sun, as the eccentricity of its pitch circle; it turns with the input."""

from pipeline.config.dimensions.dimension import CRANKS, Dimension

DIMENSION = Dimension(
    name="sun_runout",
    title="run-out of sun",
    sign="way of the pitch circle's centre from the axis, half of an indicator's reading; direction random",
    meaning="way of the sun's pitch circle from the axis, half of an indicator's reading",
    rank=85,
    draw_columns=(148, 149),
    need=CRANKS,
    one_sided=True,
    direction="direction of that way, counterclockwise from the crank at 0; it turns with the sun",
    counted_where_varied=True,
    displaces=True,
)
