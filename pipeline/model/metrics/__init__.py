"""The numbers that a reducer is judged by.

The table ``METRICS`` of `loop.py` has them; adding one is adding an entry, or a file with one ``METRIC``: its column
in the tables, its limit in a study file, its row, figure and definition in the report follow from it.
"""

from pipeline.model.metrics.metric import (
    CONTINUOUS_TURN,
    WHOLE_TURN,
    Definitions,
    Limited,
    LoopReadings,
    Metric,
    Quantity,
    library,
    measurable_metrics,
    signed_number,
)

__all__ = [
    "CONTINUOUS_TURN",
    "WHOLE_TURN",
    "Definitions",
    "Limited",
    "LoopReadings",
    "Metric",
    "Quantity",
    "library",
    "measurable_metrics",
    "signed_number",
]
