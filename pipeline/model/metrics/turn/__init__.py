"""The numbers of a unit over the whole turn.

The table ``TURN_METRICS`` of `table.py` has them; adding one is adding an entry, or a file with one ``TURN_METRIC``:
its column in the table of units, its limit in a study file, its distribution, its row and its definition in the report
follow from it.
"""

from pipeline.model.metrics.turn.turn_metric import (
    FEWEST_ANGLES,
    NEEDS,
    READ_AT,
    RunningConditions,
    TurnMetric,
    TurnReadings,
    peak_to_peak,
    turn_library,
)

__all__ = [
    "FEWEST_ANGLES",
    "NEEDS",
    "READ_AT",
    "RunningConditions",
    "TurnMetric",
    "TurnReadings",
    "peak_to_peak",
    "turn_library",
]
