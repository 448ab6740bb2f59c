"""A unit whose crank turned while a torque was held, with its faults."""

from functools import cached_property

from pipeline.identification.measurement.faults.fault import Fault
from pipeline.identification.measurement.turning.turned_rows import TurnedRows
from pipeline.identification.measurement.turning.turning_faults import turning_faults


class TurningMeasurement(TurnedRows):
    """A record of a turning drive: positions are intervals of the crank, branches are turns."""

    @cached_property
    def faults(self) -> tuple[Fault, ...]:
        """Faults of the data, fatal ones and notes."""
        return tuple(turning_faults(self))
