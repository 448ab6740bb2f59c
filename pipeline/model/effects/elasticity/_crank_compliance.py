"""Compliances of the output that vary over a turn of the crank: what the effects of every order share."""

from collections.abc import Sequence

import numpy as np

from pipeline.model.effects.effect import Conditions, Effect, Parameter, largest_twist
from pipeline.model.effects.elasticity.output_torsion import LinearSpring
from pipeline.model.load_history.drive import Drive
from pipeline.model.units import ARCMIN


def crank_compliance(
    order: int, word: str, physics: str, signature: str, confused_with: tuple[str, ...], told_apart_by: str, needs: set
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
        source=f"harmonic {order} of a compliance in series with the output, about a mean that keeps it from zero up",
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
