"""The measurement of a unit, of loops at standing cranks or of a crank that turns."""

from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.turning.turning_measurement import TurningMeasurement
from pipeline.identification.measurement.unit_file import UnitFile
from pipeline.identification.measurement.unit_sections import NEITHER


def read_measurement(unit: UnitFile) -> Measurement:
    """The measurement of a unit.

    Raises
    ------
    InputError : as ``read_rows``.
    """
    return (TurningMeasurement if unit.settings.locked == NEITHER else Measurement).read(unit)
