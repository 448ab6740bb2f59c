"""What tables call by a column name, as an engineer calls it."""

from pipeline.model.metrics import library

METRICS = library()
"""The metrics by column name."""

PARAMETERS = {
    "disk_profile": "disk profile (whole disk)",
    "lobe_profile": "lobe profile (each lobe)",
    "pin_radial": "radial pin position",
    "pin_tangential": "tangential pin position",
    "pin_radius": "pin radius",
    "ovality_2": "two-lobed ovality of pin circle",
    "ovality_3": "three-lobed ovality of pin circle",
    "eccentricity": "eccentricity",
    "roller_diameter": "output roller or pin diameter",
    "bearing_clearance": "bearing clearance",
    "sum": "sum of all",
}


def parameter_title(name: str) -> str:
    """Name of an error of a sample or of a group of errors; ``pin_radial_mean_um`` is the pins' mean."""
    bare = name.removesuffix("_um")
    mean = bare.endswith("_mean")
    bare = bare.removesuffix("_mean").removesuffix("_amplitude")
    title = PARAMETERS.get(bare, bare.replace("_", " "))
    return f"{title}, mean" if mean else title
