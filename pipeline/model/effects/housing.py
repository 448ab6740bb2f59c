"""Pins and their circle: size, radius, lobes out of round, growth with temperature."""

from collections.abc import Sequence

import numpy as np

from pipeline.model.effects.effect import (
    CRANKS,
    LARGEST_INTERFERENCE,
    TEMPERATURE,
    Conditions,
    Effect,
    Parameter,
    clearances,
)
from pipeline.model.load_history.drive import Drive

PIN_CIRCLE_ERROR = Effect(
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
    apply=lambda drive, values, conditions: drive.with_added_errors(pin_radial=np.array(1e-3 * values[0])),
)


PIN_RADIUS_ERROR = Effect(
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
    apply=lambda drive, values, conditions: drive.with_added_errors(pin_radius=np.array(1e-3 * values[0])),
)


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
            Parameter("cosine_um", "um", "amplitude at the direction of crank angle zero"),
            Parameter("sine_um", "um", "amplitude a quarter of its period on, counterclockwise"),
        ),
        changes="radial position of every pin",
        signature=f"play varies over the crank angle, {word} waves a turn",
        confused_with=(confusable,),
        told_apart_by=f"the housing's roundness, or six crank angles over {period} of a turn",
        bounds=bounds,
        apply=apply,
        needs=frozenset({CRANKS}),
    )


OVALITY_2 = ovality(2, "two", period="half", confusable="ovality_3")


OVALITY_3 = ovality(3, "three", period="a third", confusable="ovality_2")


def _apply_thermal_growth(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    growth = 1e-6 * values[0] * drive.profile.pin_circle_radius
    return drive.with_added_errors(pin_radial=growth * conditions.temperature_rise[:, None])


THERMAL_GROWTH = Effect(
    name="thermal_growth",
    title="growth of the housing against the disk with temperature",
    physics="the pin circle grows with the difference of the coefficients of expansion of housing and disk",
    source="linear thermal expansion",
    parameters=(Parameter("difference_um_per_m_K", "um/(m K)", "expansion of the housing less that of the disk"),),
    changes="radial position of all pins, with the temperature above that of the drawing",
    signature="play follows the temperature",
    confused_with=("run_in",),
    told_apart_by="the same loop at two temperatures",
    bounds=lambda drive: ((-200.0, 200.0),),
    apply=_apply_thermal_growth,
    needs=frozenset({TEMPERATURE}),
)

EFFECTS = (PIN_CIRCLE_ERROR, PIN_RADIUS_ERROR, OVALITY_2, OVALITY_3, THERMAL_GROWTH)
