"""The small study of the examples: 60 units of the paper's reducer at two crank angles, coarse mesh, one process."""

from pipeline import load_study
from pipeline.config import Study

SMALL = {
    "samples.count": 60,
    "run.jobs": 1,
    "cycle.levels_per_branch": 4,
    "cycle.rigid_angles": 13,
    "reduce.flank_edges_per_lobe": 12,
    "reduce.patch_half_width_mm": 0.3,
    "reduce.growth": 1.0,
    "reduce.largest_edge_mm": 3.0,
}
"""What differs from the study `quick`; these numbers are too coarse for results."""


def small_study(name: str, **changes: object) -> Study:
    """The study `quick` with the numbers of `SMALL`, and further changes by dotted key with `__` for the dot."""
    dotted = {key.replace("__", "."): value for key, value in changes.items()}
    return load_study("quick").with_(SMALL | {"name": name} | dotted)
