"""What tables call by a column name, as an engineer calls it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Quantity:
    """Name, unit and digits of a number that people read.

    Attributes
    ----------
    decimals : digits after the point in tables and labels.
    smaller_is_worse : whether its limit is a lower one.
    """

    title: str
    unit: str
    decimals: int
    smaller_is_worse: bool = False

    @property
    def inline(self) -> str:
        """The title inside a sentence."""
        return self.title[0].lower() + self.title[1:]

    @property
    def axis(self) -> str:
        """Label of an axis."""
        return f"{self.title} ({self.unit})"

    def text(self, value: float) -> str:
        """The value with its digits, without the unit."""
        return signed(value, self.decimals)


def signed(value: float, decimals: int) -> str:
    """A number with grouped digits and a true minus sign; what rounds to 0 has none."""
    return f"{round(value, decimals) + 0.0:,.{decimals}f}".replace("-", "\u2212")


METRICS = {
    "clearance_backlash_arcmin": Quantity("Clearance backlash", "arcmin", 3),
    "zero_torque_width_arcmin": Quantity("Zero-torque width", "arcmin", 3),
    "hysteresis_loss_arcmin": Quantity("Hysteresis loss", "arcmin", 3),
    "lost_motion_arcmin": Quantity("Lost motion", "arcmin", 3),
    "torsional_rigidity_Nm_per_arcmin": Quantity("Torsional rigidity", "N m/arcmin", 3, smaller_is_worse=True),
    "peak_pressure_MPa": Quantity("Peak Hertz pressure", "MPa", 0),
}

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
    "remainder": "rest: not linear in the errors",
}


def parameter_title(name: str) -> str:
    """Name of an error of a sample or of a group of errors; ``pin_radial_mean_um`` is the pins' mean."""
    bare = name.removesuffix("_um")
    mean = bare.endswith("_mean")
    bare = bare.removesuffix("_mean").removesuffix("_amplitude")
    title = PARAMETERS.get(bare, bare.replace("_", " "))
    return f"{title}, mean" if mean else title
