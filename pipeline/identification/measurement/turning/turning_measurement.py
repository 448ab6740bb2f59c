"""A record of a drive whose crank turns, or of loops, as the settings of the unit say."""

from functools import cached_property

from pipeline.identification.measurement.faults.fault import Fault
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.turning.turned_rows import TurnedRows
from pipeline.identification.measurement.turning.turning_faults import turning_faults
from pipeline.identification.measurement.unit_file import UnitFile
from pipeline.identification.measurement.unit_sections import NEITHER


class TurningMeasurement(TurnedRows):
    """A record of a turning drive: positions are intervals of the crank, branches are turns."""

    @cached_property
    def faults(self) -> tuple[Fault, ...]:
        """Faults of the data, fatal ones and notes."""
        return tuple(turning_faults(self))


def read_measurement(unit: UnitFile) -> Measurement:
    """The measurement of a unit.

    Raises
    ------
    InputError : as ``read_rows``.
    """
    return (TurningMeasurement if unit.settings.locked == NEITHER else Measurement).read(unit)
