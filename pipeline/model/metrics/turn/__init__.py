"""The numbers of a unit over the whole turn, one file each.

A file defines ``TURN_METRIC``; adding one is adding a file: its column in the table of units, its limit in a study
file, its distribution, its row and its definition in the report follow from it.
"""

from pipeline.model.metrics.turn.turn_metric import (
    FEWEST_ANGLES,
    NEEDS,
    RunningConditions,
    TurnMetric,
    TurnReadings,
    turn_library,
)

__all__ = ["FEWEST_ANGLES", "NEEDS", "RunningConditions", "TurnMetric", "TurnReadings", "turn_library"]
