"""Compliance of the pins' seats in the housing."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.model.effects.effect import Conditions, Effect, Parameter
from pipeline.model.load_history.drive import Drive


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    linear = drive.laws.linear.copy()
    linear[: drive.reducer.n_pins] += 1e-3 * values[0]
    return replace(drive, laws=replace(drive.laws, linear=linear))


def _bounds(drive: Drive) -> tuple[tuple[float, float], ...]:
    share = drive.rated_torque / (0.25 * np.sum(np.abs(drive.reducer.pins.arm)))
    specific = drive.laws.compliance(np.full(len(drive.laws), share))[0]
    return ((0.0, 2e4 * specific),)


EFFECT = Effect(
    name="seat_compliance",
    title="compliance of the pins' seats and the housing",
    physics="every pin gives way elastically in its seat, in series with its contact",
    source="series of a linear spring with the law of the contact",
    parameters=(Parameter("compliance_um_per_N", "um/N", "of one seat"),),
    changes="the linear part of the pins' force laws",
    signature="rigidity falls at all loads, and more pins share the load",
    confused_with=("output_torsion",),
    told_apart_by="the twist of the housing ring against the frame under load",
    bounds=_bounds,
    apply=_apply,
)
