"""Run-out of the disk's flank against its bore."""

from collections.abc import Sequence

import numpy as np

from pipeline.model.effects.effect import CRANKS, LARGEST_CLEARANCE, MOVES, Conditions, Effect, Parameter
from pipeline.model.load_history.drive import Drive


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    return drive.moved(bore_runout=1e-3 * np.array(values))


def _bounds(drive: Drive) -> tuple[tuple[float, float], ...]:
    reach = 1e3 * LARGEST_CLEARANCE * drive.profile.eccentricity
    return ((-reach, reach),) * 2


EFFECT = Effect(
    name="flank_runout",
    title="run-out of the flank, or of the disk's bore",
    physics="the centre of the lobes lies off the bore: as a run-out of the pin circle, in a frame that turns "
    "with the disk, and so of order N/Z of the crank",
    source="exact gaps of displaced pins; pitch point after Litvin and Fuentes, Gear Geometry (2004), ch. 13",
    parameters=(
        Parameter("x_um", "um", "centre of the flank from that of the bore, along the first lobe's valley"),
        Parameter("y_um", "um", "the same a quarter turn of the disk on"),
    ),
    changes="place of the flank on the disk",
    signature="as that of the pin circle, but its phase moves by a quarter as the output turns by a quarter",
    confused_with=("pin_circle_runout", "crank_compliance_1", "encoder_eccentricity"),
    told_apart_by="positions a quarter of an output turn apart",
    bounds=_bounds,
    apply=_apply,
    needs=frozenset({CRANKS, MOVES}),
)
