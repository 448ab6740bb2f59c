"""Two-lobed ovality of the housing."""

from collections.abc import Sequence

import numpy as np

from pipeline.model.drive import Drive
from pipeline.model.effects.effect import CRANKS, LARGEST_INTERFERENCE, Conditions, Effect, Parameter


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    angle = 2 * drive.profile.pin_angle()
    return drive.moved(pin_radial=1e-3 * (values[0] * np.cos(angle) + values[1] * np.sin(angle)))


def _symmetric(drive: Drive) -> tuple[float, float]:
    reach = 2e3 * LARGEST_INTERFERENCE * drive.profile.eccentricity
    return -reach, reach


EFFECT = Effect(
    name="ovality_2",
    title="two-lobed ovality of the housing",
    physics="the pin circle is no circle: its radius varies with the angle",
    source="radial displacement a cos(k theta)",
    parameters=(
        Parameter("cosine_um", "um", "amplitude along the angle 0"),
        Parameter("sine_um", "um", "amplitude along a quarter of its period"),
    ),
    changes="radial position of every pin",
    signature="play varies over the crank angle, two waves a turn",
    confused_with=("ovality_3",),
    bounds=lambda drive: (_symmetric(drive),) * 2,
    apply=_apply,
    needs=frozenset({CRANKS}),
)
