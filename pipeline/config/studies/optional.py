"""What a study may leave out: other forms of the model, far tails, and mesh numbers, which follow from the design.

The section of tails says how many units a rough model looks at, how many are load-solved, and what has no tail.
"""

from collections.abc import Mapping
from math import ceil, isfinite
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from pipeline.config.designs.design import Design
from pipeline.config.designs.flank import flank_profile
from pipeline.config.files.section import Section
from pipeline.model.metrics import library

if TYPE_CHECKING:
    from pipeline.config.studies.study import Limits, Samples


class ModelForms(Section):
    """Uncertainty of the model's form: the first `units` of the study are solved again under other forms of the model.

    The forms are every other contact law, the other plane state of stress, a rigid in place of an elastic disk or the
    reverse, and each calibrated number of the design at both ends of its range.
    """

    units: Annotated[int, Field(ge=30, le=100_000)] = 300


class Tails(Section):
    """Shares of units beyond each limit, in parts per million, and 99.73 % quantiles.

    A rough model looks at `units`; about `solve` of them, most near a limit, are load-solved beside a pilot.
    """

    units: Annotated[int, Field(ge=1_000, le=10**8)] = 100_000
    solve: Annotated[int, Field(ge=100, le=10**7)] = 4_000


def limited_under_load(limits: "Limits") -> dict[str, float]:
    """Limits by metric, of those that have a rough model: rigid bodies need none, metrics of the turn have none."""
    metrics = library()
    return {n: limit for n, limit in limits.of_metrics.items() if n in metrics and not metrics[n].turn_of_rigid_bodies}


def without_tails(samples: "Samples", limits: "Limits") -> str:
    """Why a study has no far tails; empty if it has."""
    if samples.experiment == "cases":
        return "listed cases are no sample of anything; tails need random samples"
    if not limited_under_load(limits):
        return "[limits] names no metric under load; set one, as lost_motion_arcmin"
    return ""


PATCH_SHARE = 0.1
"""Half width of a patch over the radius of the body that presses on it."""
EDGES_PER_HALF_WIDTH = 2
"""Edges of the flank under half of a patch."""
FEWEST_EDGES, MOST_EDGES, NARROWEST = 8, 2000, 1e-3
"""Bounds of the edges of a lobe, and of the half width of a patch [mm], as of the section `reduce`."""
GROWTH = 0.35
"""Growth of the edges with the depth below the flank."""
EDGES_OF_RADIUS = 30
"""Largest edges along the radius of the pin circle."""
ARC_SAMPLES = 2000
"""Points of a lobe whose chords are its length."""

ANY_MESH = {
    "patch_half_width_mm": 1.0,
    "flank_edges_per_lobe": 8,
    "growth": GROWTH,
    "largest_edge_mm": 1.0,
    "roller_patch_half_width_mm": 1.0,
}
"""Mesh of a study whose design cannot be read, so that no key of the mesh is reported as missing."""


def with_mesh(reduce: Mapping[str, Any], design: Design) -> dict[str, Any]:
    """The section `reduce` of a study file, completed by the numbers that follow from its design.

    Notes
    -----
    Edges half as long and, in holes, patches half as wide move lost motion, rigidity and pressure of the nominal
    reducer by less than 0.1 % for `li_guan` and `pin_in_hole_39`, and by 1.8 % for `printed_drive`.
    """
    cycloid, output = design.cycloid, design.output
    stated = reduce.get("patch_half_width_mm")
    width = (
        stated if isinstance(stated, float | int) and stated > 0 else _three_digits(PATCH_SHARE * cycloid.pin_radius_mm)
    )
    edges = EDGES_PER_HALF_WIDTH * lobe_length(design) / max(width, NARROWEST)
    rolling = output.patch_half_width_mm(PATCH_SHARE)
    defaults = {
        "patch_half_width_mm": width,
        "flank_edges_per_lobe": min(max(ceil(edges), FEWEST_EDGES), MOST_EDGES),
        "growth": GROWTH,
        "largest_edge_mm": _three_digits(cycloid.pin_circle_radius_mm / EDGES_OF_RADIUS),
        "roller_patch_half_width_mm": _three_digits(rolling) if isfinite(rolling) else width,
    }
    return {**defaults, **reduce}


def lobe_length(design: Design) -> float:
    """Length of the flank of one lobe [mm]."""
    profile = flank_profile(design.cycloid, design.flank)
    return float(np.abs(np.diff(profile.flank(np.linspace(0, profile.lobe_pitch, ARC_SAMPLES)))).sum())


def _three_digits(value: float) -> float:
    return float(f"{value:.3g}")
