"""Compliance of the output that varies twice a turn of the crank."""

from collections.abc import Sequence

import numpy as np

from pipeline.model.effects.effect import CRANKS, TORQUES, Conditions, Effect, Parameter, largest_twist
from pipeline.model.effects.elasticity.output_torsion import LinearSpring
from pipeline.model.load_history.drive import Drive
from pipeline.model.units import ARCMIN

ORDER = 2
"""Waves of the compliance in a turn of the crank."""


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    angle = ORDER * drive.reducer.crank
    wave = np.hypot(values[0], values[1]) + values[0] * np.cos(angle) + values[1] * np.sin(angle)
    return drive.with_elements(LinearSpring(1e-3 * float(wave) / ARCMIN))


EFFECT = Effect(
    name="crank_compliance_2",
    title="compliance that varies twice a turn of the crank",
    physics="bearings of the cranks, or what carries them, are not alike in all directions or in all cranks: as the "
    "eccentrics turn, the resultant of the pins loads softer and stiffer ones, twice a turn",
    source="second harmonic of a compliance in series with the output, about a mean that keeps it from zero upwards",
    parameters=(
        Parameter("cosine_arcmin_per_Nm", "arcmin/(N m)", "wave of the compliance with cos of twice the crank angle"),
        Parameter("sine_arcmin_per_Nm", "arcmin/(N m)", "wave of the compliance with sin of twice the crank angle"),
    ),
    changes="adds a wave of the compliance times the torque to the rotation of the output",
    signature="order 2 of the transmission error in proportion to the torque, of the torque's sign in either sense",
    confused_with=("ovality_2",),
    told_apart_by="the order 2 at several torques: that of an ovality does not grow in proportion to the torque",
    bounds=lambda drive: ((-largest_twist(drive), largest_twist(drive)),) * 2,
    apply=_apply,
    needs=frozenset({CRANKS, TORQUES}),
)
