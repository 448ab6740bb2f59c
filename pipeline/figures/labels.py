"""What tables call by a column name, as an engineer calls it."""

from pipeline.config.dimensions import dimension_library
from pipeline.model.metrics import library

METRICS = library()
"""The metrics by column name."""

PARAMETERS = {name: dimension.title for name, dimension in dimension_library().items()} | {"sum": "sum of all"}


def parameter_title(name: str) -> str:
    """Name of an error of a sample or of a group of errors; ``pin_radial_mean_um`` is the pins' mean."""
    bare = name.removesuffix("_um")
    mean = bare.endswith("_mean")
    bare = bare.removesuffix("_mean").removesuffix("_amplitude")
    title = PARAMETERS.get(bare, bare.replace("_", " "))
    return f"{title}, mean" if mean else title
