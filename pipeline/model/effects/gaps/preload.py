"""Interference of the disk with its pins."""

from collections.abc import Sequence

import numpy as np

from pipeline.model.effects.effect import LARGEST_INTERFERENCE, Conditions, Effect, Parameter
from pipeline.model.load_history.drive import Drive


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    closing = np.zeros_like(drive.shift)
    closing[:, : drive.reducer.n_pins] = -1e-3 * values[0]
    return drive.with_added_gap(closing)


EFFECT = Effect(
    name="preload",
    title="preload of the disk against its pins",
    physics="a disk pressed or grown into its pins closes every gap along the normal by the same amount",
    source="normal reading of a profile error (mechanics of gaps: g = -d on every flank)",
    parameters=(Parameter("interference_um", "um", "gap taken away at every pin"),),
    changes="gap of every pin",
    signature="no play, high rigidity near zero torque",
    confused_with=("pin_radius_error", "pin_circle_error"),
    told_apart_by="the running torque without load: interference raises it",
    bounds=lambda drive: ((0.0, 1e3 * LARGEST_INTERFERENCE * drive.profile.eccentricity),),
    apply=_apply,
)
