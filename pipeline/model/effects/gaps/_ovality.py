"""Housings out of round: what the effects of every order share."""

from collections.abc import Sequence

import numpy as np

from pipeline.model.effects.effect import CRANKS, LARGEST_INTERFERENCE, Conditions, Effect, Parameter
from pipeline.model.load_history.drive import Drive


def ovality(order: int, word: str, period: str, confusable: str) -> Effect:
    """The effect of a pin circle with ``order`` lobes, ``word`` for people, of a ``period``; alike: ``confusable``."""

    def apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
        angle = order * drive.profile.pin_angle()
        return drive.with_added_errors(pin_radial=1e-3 * (values[0] * np.cos(angle) + values[1] * np.sin(angle)))

    def bounds(drive: Drive) -> tuple[tuple[float, float], ...]:
        reach = 2e3 * LARGEST_INTERFERENCE * drive.profile.eccentricity
        return ((-reach, reach),) * 2

    return Effect(
        name=f"ovality_{order}",
        title=f"{word}-lobed ovality of the housing",
        physics="the pin circle is no circle: its radius varies with the angle",
        source="radial displacement a cos(k theta)",
        parameters=(
            Parameter("cosine_um", "um", "amplitude along the angle 0"),
            Parameter("sine_um", "um", "amplitude along a quarter of its period"),
        ),
        changes="radial position of every pin",
        signature=f"play varies over the crank angle, {word} waves a turn",
        confused_with=(confusable,),
        told_apart_by=f"the housing's roundness, or six crank angles over {period} of a turn",
        bounds=bounds,
        apply=apply,
        needs=frozenset({CRANKS}),
    )
