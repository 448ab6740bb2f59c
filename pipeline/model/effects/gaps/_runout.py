"""Run-outs of the pin circle and of the flank: what both effects share."""

from collections.abc import Callable, Sequence

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
    meaning : of x; that of y is the same a quarter turn on.
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
        parameters=(Parameter("x_um", "um", meaning), Parameter("y_um", "um", f"{meaning}, a quarter turn on")),
        changes=changes,
        signature=signature,
        confused_with=(twin, "crank_compliance_1", "encoder_eccentricity"),
        told_apart_by=told_apart_by,
        bounds=bounds,
        apply=apply,
        needs=frozenset({CRANKS, MOVES}),
    )
