"""Constant friction of seals and bearings."""

from collections.abc import Sequence

import numpy as np

from pipeline.model.contact.friction_elements import output_sliders
from pipeline.model.effects.effect import SENSES, Conditions, Effect, Parameter
from pipeline.model.elements import Friction
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.load_cycle import ARCMIN

DISTANCE = 0.01 / ARCMIN
"""Rotation [rad] over which the friction rises: a hundredth of an arcmin, below what benches resolve."""


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    torque = np.array([1e3 * values[0]])
    return drive.with_elements(Friction(output_sliders(drive.reducer, torque, np.array([DISTANCE]))))


EFFECT = Effect(
    name="coulomb",
    title="constant friction of seals and bearings",
    physics="the turning end resists with a torque of constant size against its motion, whatever the load",
    source="Coulomb; Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083",
    parameters=(Parameter("torque_Nm", "N m", "friction torque, referred to the output"),),
    changes="a slider on the rotation of the output",
    signature="branches stand apart by the same torque at every load; the width at zero torque grows",
    confused_with=("contact_friction", "presliding"),
    told_apart_by="a slow ramp to a tenth of the load: constant friction opens it as wide as the full one, and loops "
    "at another rate as wide as before; viscous friction grows with the rate, and loops of one rate do not tell it",
    bounds=lambda drive: ((0.0, 0.5e-3 * drive.rated_torque),),
    apply=_apply,
    needs=frozenset({SENSES}),
)
