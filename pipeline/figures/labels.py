"""What tables call by a column name, as an engineer calls it; no plotting library is imported for it."""

from pipeline.config.dimensions import dimension_library
from pipeline.model.metrics import Limited, library
from pipeline.model.metrics.turn import turn_library

METRICS = library()
"""The metrics by column name."""
LIMITED_METRICS: dict[str, Limited] = {**METRICS, **turn_library()}
"""What a limit may be set for: the metrics of loops, then those of the whole turn."""

FULL_TURN = 360.0
"""Crank angle [deg] beyond which loaded angles stand more than a turn of the crank apart: no line joins them."""
PARAMETERS = {name: dimension.title for name, dimension in dimension_library().items()} | {"sum": "sum of all"}


def parameter_title(name: str) -> str:
    """Name of an error of a sample or of a group of errors; ``pin_radial_mean_um`` is the pins' mean."""
    bare = name.removesuffix("_um")
    mean = bare.endswith("_mean")
    bare = bare.removesuffix("_mean").removesuffix("_amplitude")
    title = PARAMETERS.get(bare, bare.replace("_", " "))
    return f"{title}, mean" if mean else title
