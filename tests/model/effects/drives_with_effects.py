"""Drives with an effect of the library."""

from pipeline.model.effects import Conditions, library
from pipeline.model.load_history.backbone import torque_levels

LIBRARY = library()
SHARES = torque_levels(20, 1.05)
MIDDLE = len(SHARES) + 1  # the positive end of play


def put(drive, name, *values, conditions=None):
    """The drive with an effect of the library."""
    return LIBRARY[name].apply(drive, values, conditions or Conditions.run_in(len(drive.gap)))
