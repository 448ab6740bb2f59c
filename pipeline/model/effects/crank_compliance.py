"""Compliances of the output that vary once and twice over a turn of the crank."""

from collections.abc import Sequence

import numpy as np

from pipeline.model.effects.compliance import LinearSpring
from pipeline.model.effects.effect import CRANKS, MOVES, TORQUES, Conditions, Effect, Parameter, largest_twist
from pipeline.model.load_history.drive import Drive
from pipeline.model.units import ARCMIN


def crank_compliance(
    order: int,
    word: str,
    physics: str,
    signature: str,
    confused_with: tuple[str, ...],
    told_apart_by: str,
    needs: set[str],
) -> Effect:
    """The effect of a compliance with ``order`` waves in a turn of the crank, ``word`` for people."""

    def apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
        angle = order * drive.reducer.crank
        wave = np.hypot(values[0], values[1]) + values[0] * np.cos(angle) + values[1] * np.sin(angle)
        return drive.with_elements(LinearSpring(1e-3 * float(wave) / ARCMIN))

    times = "the crank angle" if order == 1 else f"{word} the crank angle"
    return Effect(
        name=f"crank_compliance_{order}",
        title=f"compliance that varies {word} a turn of the crank",
        physics=physics,
        source=f"harmonic {order} of a compliance in series with the output, about a mean of its own amplitude, "
        "which keeps it from zero up",
        parameters=tuple(
            Parameter(f"{part}_arcmin_per_Nm", "arcmin/(N m)", f"wave of the compliance with {wave} of {times}")
            for part, wave in (("cosine", "cos"), ("sine", "sin"))
        ),
        changes="adds a wave of the compliance times the torque to the rotation of the output",
        signature=signature,
        confused_with=confused_with,
        told_apart_by=told_apart_by,
        bounds=lambda drive: ((-largest_twist(drive), largest_twist(drive)),) * 2,
        apply=apply,
        needs=frozenset(needs),
    )


CRANK_COMPLIANCE_1 = crank_compliance(
    order=1,
    word="once",
    physics="one side of the housing or of the pins' seats deflects more than the other: as the crank turns, the load "
    "goes through softer and stiffer ones, once a turn",
    signature="loops are steeper at high torque at some crank angles than half a turn of the crank away",
    confused_with=("pin_circle_runout", "encoder_eccentricity"),
    told_apart_by="an unloaded turn of the crank: no error there",
    needs={CRANKS, MOVES},
)


CRANK_COMPLIANCE_2 = crank_compliance(
    order=2,
    word="twice",
    physics="bearings of the cranks, or what carries them, are not alike in all directions or in all cranks: as the "
    "eccentrics turn, the resultant of the pins loads softer and stiffer ones, twice a turn",
    signature="order 2 of the transmission error in proportion to the torque, of the torque's sign in either sense",
    confused_with=("ovality_2",),
    told_apart_by="the order 2 at several torques: that of an ovality does not grow in proportion to the torque",
    needs={CRANKS, TORQUES},
)

EFFECTS = (CRANK_COMPLIANCE_1, CRANK_COMPLIANCE_2)
