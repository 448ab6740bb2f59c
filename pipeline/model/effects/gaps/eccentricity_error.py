"""Eccentricity of the crank larger or smaller."""

from collections.abc import Sequence

import numpy as np

from pipeline.model.effects.effect import LARGEST_INTERFERENCE, Conditions, Effect, Parameter
from pipeline.model.load_history.drive import Drive


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    return drive.with_added_errors(eccentricity=np.array(1e-3 * values[0]))


def _symmetric(drive: Drive) -> tuple[float, float]:
    reach = 2e3 * LARGEST_INTERFERENCE * drive.profile.eccentricity
    return -reach, reach


EFFECT = Effect(
    name="eccentricity_error",
    title="eccentricity of the crank larger or smaller",
    physics="the crank holds the disk further out than declared: gaps change by n . u de, to first order",
    source="exact gaps of a displaced disk",
    parameters=(Parameter("eccentricity_um", "um", "eccentricity larger by"),),
    changes="eccentricity",
    signature="other pins touch first; rigidity and play change together, alike at every crank angle",
    confused_with=("bearing_clearance", "pin_circle_error"),
    told_apart_by="the throw of the crank with a dial gauge",
    bounds=lambda drive: (_symmetric(drive),),
    apply=_apply,
)
