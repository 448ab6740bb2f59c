"""Wear of one flank."""

from collections.abc import Sequence

import numpy as np

from pipeline.model.effects.effect import Conditions, Effect, Parameter
from pipeline.model.load_history.drive import Drive


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    opening, arm = np.zeros_like(drive.shift), drive.reducer.pins.arm
    worn = np.flatnonzero(arm < 0 if values[0] > 0 else arm > 0)
    opening[:, worn] = 1e-3 * abs(values[0])
    return drive.with_added_gap(opening)


EFFECT = Effect(
    name="flank_wear",
    title="wear of one flank",
    physics="the flanks that carry one sense of torque have lost material along their normal",
    source="uniform depth along the normal",
    parameters=(Parameter("depth_um", "um", "depth; positive: on the flanks loaded by positive torque"),),
    changes="gap of the pins that carry one sense of torque",
    signature="one end of the play moves, the other stays",
    confused_with=("pin_circle_error", "pin_radius_error"),
    told_apart_by="both flanks of a lobe on a form tester, or an absolute zero of the angle",
    bounds=lambda drive: ((-1e3 * drive.profile.eccentricity / 3, 1e3 * drive.profile.eccentricity / 3),),
    apply=_apply,
)
