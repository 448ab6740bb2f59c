"""How the columns of a unit's files are named, and in which units they are."""

from typing import Annotated, Literal

from pydantic import Field

from pipeline.config.files.section import Section

Text = Annotated[str, Field(min_length=1)]

TORQUE_UNITS = {"N m": 1.0, "mN m": 1e-3, "kN m": 1e3, "N mm": 1e-3, "lbf in": 0.1129848290276167}
ANGLE_UNITS = {
    "arcmin": 1.0,
    "deg": 60.0,
    "rad": 3437.7467707849396,
    "rev": 21600.0,
    "mrad": 3.4377467707849396,
    "arcsec": 1 / 60,
}
CRANK_UNITS = {"deg": 1.0, "rad": 57.29577951308232, "rev": 360.0, "mrad": 0.05729577951308232, "arcsec": 1 / 3600}
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "min": 60.0, "us": 1e-6}
TEMPERATURE_UNITS = {"C": (1.0, 0.0), "K": (1.0, -273.15), "F": (5 / 9, -160 / 9)}


class FileColumn(Section):
    """A column of the files: value = factor x (what is written, in the standard unit) + offset in the standard unit."""

    name: Text
    factor: float = 1.0
    offset: float = 0.0

    @property
    def to_standard(self) -> tuple[float, float]:
        """Scale and shift from what is written to the standard unit."""
        return 1.0, 0.0


class TorqueColumn(FileColumn):
    """A torque."""

    unit: Literal["N m", "mN m", "kN m", "N mm", "lbf in"] = "N m"

    @property
    def to_standard(self) -> tuple[float, float]:
        return TORQUE_UNITS[self.unit], 0.0


class AngleColumn(FileColumn):
    """An angle of the output."""

    unit: Literal["arcmin", "deg", "rad", "rev", "mrad", "arcsec"] = "arcmin"

    @property
    def to_standard(self) -> tuple[float, float]:
        return ANGLE_UNITS[self.unit], 0.0


class CrankColumn(FileColumn):
    """The crank angle."""

    unit: Literal["deg", "rad", "rev", "mrad", "arcsec"] = "deg"

    @property
    def to_standard(self) -> tuple[float, float]:
        return CRANK_UNITS[self.unit], 0.0


class TimeColumn(FileColumn):
    """The time."""

    unit: Literal["s", "ms", "min", "us"] = "s"

    @property
    def to_standard(self) -> tuple[float, float]:
        return TIME_UNITS[self.unit], 0.0


class TemperatureColumn(FileColumn):
    """The temperature."""

    unit: Literal["C", "K", "F"] = "C"

    @property
    def to_standard(self) -> tuple[float, float]:
        return TEMPERATURE_UNITS[self.unit]


class Columns(Section):
    """Where each quantity stands in the files; one that is not named here stands under its own name.

    `input_deg` and `output_deg` are the encoders of a record with neither end locked, `input_rpm` is the input's speed.
    """

    cycle: FileColumn = FileColumn(name="cycle")
    crank_deg: CrankColumn = CrankColumn(name="crank_deg")
    torque_Nm: TorqueColumn = TorqueColumn(name="torque_Nm")
    angle_arcmin: AngleColumn = AngleColumn(name="angle_arcmin")
    time_s: TimeColumn = TimeColumn(name="time_s")
    temperature_C: TemperatureColumn = TemperatureColumn(name="temperature_C")
    command_torque_Nm: TorqueColumn = TorqueColumn(name="command_torque_Nm")
    input_deg: CrankColumn = CrankColumn(name="input_deg")
    output_deg: CrankColumn = CrankColumn(name="output_deg")
    input_rpm: FileColumn = FileColumn(name="input_rpm")
