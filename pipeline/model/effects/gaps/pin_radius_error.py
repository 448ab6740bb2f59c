"""All pins thicker or thinner."""

from collections.abc import Sequence

import numpy as np

from pipeline.model.effects.effect import Conditions, Effect, Parameter, clearances
from pipeline.model.load_history.drive import Drive


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    return drive.with_added_errors(pin_radius=np.array(1e-3 * values[0]))


EFFECT = Effect(
    name="pin_radius_error",
    title="all pins thicker or thinner",
    physics="the radius of the pins differs from the declared one; so does the gap, by the same amount everywhere",
    source="g = -ds on every flank",
    parameters=(Parameter("radius_um", "um", "pins thicker by"),),
    changes="radius of all pins",
    signature="play grows or shrinks alike in both senses and at every crank angle",
    confused_with=("pin_circle_error", "preload", "bearing_clearance"),
    told_apart_by="the pins' diameter with a micrometer",
    bounds=lambda drive: (clearances(drive, shrinks=True),),
    apply=_apply,
)
