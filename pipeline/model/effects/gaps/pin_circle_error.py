"""All pins on a larger or smaller circle."""

from collections.abc import Sequence

import numpy as np

from pipeline.model.effects.effect import Conditions, Effect, Parameter, clearances
from pipeline.model.load_history.drive import Drive


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    return drive.with_added_errors(pin_radial=np.array(1e-3 * values[0]))


EFFECT = Effect(
    name="pin_circle_error",
    title="all pins on a larger or smaller circle",
    physics="the radius of the pin circle differs from the declared one",
    source="exact gaps of displaced pins",
    parameters=(Parameter("radial_um", "um", "pin circle larger by"),),
    changes="radial position of all pins",
    signature="play grows or shrinks alike in both senses and at every crank angle",
    confused_with=("pin_radius_error", "preload", "bearing_clearance"),
    told_apart_by="the diameter over the pins on a coordinate measuring machine",
    bounds=lambda drive: (clearances(drive),),
    apply=_apply,
)
