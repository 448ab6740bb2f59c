"""Bore of each bush: larger, it lies looser on its pin, as with a smaller bush."""

from pipeline.config.dimensions.output._bush_fit import bush_fit

DIMENSION = bush_fit(
    "bush_bore",
    title="bore diameter of bushes",
    sign="each bush; larger gives clearance",
    meaning="error of the bush's bore diameter",
    rank=76,
    draw_columns=(126,),
    side=-1,
)
