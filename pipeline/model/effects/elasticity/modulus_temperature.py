"""Modulus of the elastic parts against the temperature."""

from collections.abc import Sequence

import numpy as np

from pipeline.model.effects.effect import TEMPERATURE, Conditions, Effect, Parameter
from pipeline.model.elements import ElasticModulus
from pipeline.model.load_history.drive import Drive

STEEPEST = 0.02
"""Loss of modulus per kelvin that is looked for: polymers near their glass transition."""
SOFTEST, STIFFEST = 0.2, 5.0
"""Factors of the modulus beyond which the slope is no longer one: the part flows or is another material."""


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    factor = np.clip(1 - values[0] * conditions.temperature_rise, SOFTEST, STIFFEST)
    return drive.with_elements(ElasticModulus(factor, of_bearing=True))


EFFECT = Effect(
    name="modulus_temperature",
    title="modulus that falls with the temperature",
    physics="polymers soften as they warm, by 0.2 to 2 % a kelvin, steel by 0.03 %: forces on elastic parts and "
    "contacts enter as force over modulus, so that the curve is stretched along the torque, and play is left as it is",
    source="first order of the modulus in the temperature; a material's own slope is that of the storage modulus as "
    "ISO 6721-1 has it measured",
    parameters=(Parameter("loss_per_K", "1/K", "share of the modulus that is lost per kelvin"),),
    changes="stiffness of disk, contacts and bearing, with the temperature of each cycle",
    signature="rigidity falls as the drive warms, play does not",
    confused_with=("thermal_growth", "run_in"),
    told_apart_by="the same loop at two temperatures: its slope under load, not its width at zero torque",
    bounds=lambda drive: ((-STEEPEST / 4, STEEPEST),),
    apply=_apply,
    needs=frozenset({TEMPERATURE}),
)
