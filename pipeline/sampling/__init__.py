"""Manufacturing errors of any sample of a study, counted and not consumed. Arrays have the sample axis first."""

from pipeline.config.dimensions.pins import oval_shift
from pipeline.sampling.designs import replicates, uniforms
from pipeline.sampling.errors import (
    Errors,
    deviations_at,
    dimensions,
    draw,
    draw_as_measured,
    draw_with_parts,
    errors_at,
    errors_with_parts,
    joined_errors,
    unmeasured_dimensions,
    usual_beside,
)
from pipeline.sampling.pick_freeze import draw_mixed, drawn_units, error_groups

__all__ = [
    "Errors",
    "deviations_at",
    "dimensions",
    "draw",
    "draw_as_measured",
    "draw_mixed",
    "draw_with_parts",
    "drawn_units",
    "error_groups",
    "errors_at",
    "errors_with_parts",
    "joined_errors",
    "oval_shift",
    "replicates",
    "uniforms",
    "unmeasured_dimensions",
    "usual_beside",
]
