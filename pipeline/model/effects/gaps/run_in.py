"""Running in over the load cycles."""

from collections.abc import Sequence

import numpy as np

from pipeline.model.effects.effect import CYCLES, Conditions, Effect, Parameter
from pipeline.model.load_history.drive import Drive


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    worn = 1e-3 * values[0] * -np.expm1(-conditions.cycle / values[1])
    opening = np.zeros_like(drive.shift)
    opening[:, : drive.reducer.n_pins] = worn[:, None]
    return drive.with_added_gap(opening)


EFFECT = Effect(
    name="run_in",
    title="running in over the load cycles",
    physics="the first cycles wear the flanks, ever more slowly, as asperities are worn off",
    source="Archard, J. Appl. Phys. 24 (1953) 981, with a pressure that falls as the surfaces conform",
    parameters=(
        Parameter("wear_um", "um", "depth of the wear at last"),
        Parameter("cycles", "1", "number of cycles in which 63 % of it is reached", record=CYCLES),
    ),
    changes="gap of every pin, with the cycle",
    signature="play grows from cycle to cycle and settles",
    confused_with=("thermal_growth", "angle_drift"),
    told_apart_by="further cycles: wear settles",
    bounds=lambda drive: ((0.0, 1e3 * drive.profile.eccentricity / 3), (0.3, 30.0)),
    apply=_apply,
    needs=frozenset({CYCLES}),
)
