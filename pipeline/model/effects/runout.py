"""Run-outs of the pin circle and of the flank."""

from collections.abc import Callable, Sequence

import numpy as np

from pipeline.model.effects.effect import CRANKS, LARGEST_CLEARANCE, MOVES, Conditions, Effect, Parameter
from pipeline.model.load_history.drive import Drive


def runout(
    name: str,
    title: str,
    moved: Callable[[Drive, float, float], Drive],
    meaning: str,
    *,
    physics: str,
    changes: str,
    signature: str,
    told_apart_by: str,
) -> Effect:
    """The effect of a centre that lies off by x, y [mm] in its own frame, as ``moved`` puts it into a drive.

    Parameters
    ----------
    meaning : of x; that of y is the same a quarter turn on, counterclockwise.
    """
    twin = "flank_runout" if name == "pin_circle_runout" else "pin_circle_runout"

    def bounds(drive: Drive) -> tuple[tuple[float, float], ...]:
        reach = 1e3 * LARGEST_CLEARANCE * drive.profile.eccentricity
        return ((-reach, reach),) * 2

    def apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
        return moved(drive, 1e-3 * values[0], 1e-3 * values[1])

    return Effect(
        name=name,
        title=title,
        physics=physics,
        source="exact gaps of displaced pins; pitch point after Litvin and Fuentes, Gear Geometry (2004), ch. 13",
        parameters=(Parameter("x_um", "um", meaning), Parameter("y_um", "um", f"{meaning}, turned left by 90 degrees")),
        changes=changes,
        signature=signature,
        confused_with=(twin, "crank_compliance_1", "encoder_eccentricity"),
        told_apart_by=told_apart_by,
        bounds=bounds,
        apply=apply,
        needs=frozenset({CRANKS, MOVES}),
    )


def _moved(drive: Drive, x: float, y: float) -> Drive:
    cosine, sine = np.cos(drive.profile.pin_angle()), np.sin(drive.profile.pin_angle())
    return drive.with_added_errors(pin_radial=x * cosine + y * sine, pin_tangential=y * cosine - x * sine)


PIN_CIRCLE_RUNOUT = runout(
    "pin_circle_runout",
    "run-out of the pin circle",
    _moved,
    "offset of the pin circle's centre towards crank angle zero",
    physics="the centre of the pin circle lies off the common axis of crank and output by d: the disk, whose pitch "
    "point lies Z e from its centre, turns by up to d / (Z e), once per turn of the crank",
    changes="place of every pin",
    told_apart_by="positions a quarter of an output turn apart (flank); an unloaded turn of the crank (compliance); a "
    "second encoder (encoder)",
    signature="the angle has one wave over the crank angle, and the motor's torque is off by its slope times the ratio",
)


FLANK_RUNOUT = runout(
    "flank_runout",
    "run-out of the flank, or of the disk's bore",
    lambda drive, x, y: drive.with_added_errors(bore_runout=np.array([x, y])),
    "offset of the flank's centre from that of the bore, in every disk towards its own first lobe's valley",
    physics="the centre of the lobes lies off the bore: as a run-out of the pin circle, in a frame that turns "
    "with the disk, and so of order N/Z of the crank",
    changes="place of the flank on the disk",
    told_apart_by="positions a quarter of an output turn apart",
    signature="as that of the pin circle, but its phase moves by a quarter as the output turns by a quarter",
)

EFFECTS = (PIN_CIRCLE_RUNOUT, FLANK_RUNOUT)
