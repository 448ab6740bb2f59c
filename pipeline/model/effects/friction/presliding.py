"""Friction that rises over a distance before it slides (Maxwell-slip)."""

from collections.abc import Sequence

import numpy as np

from pipeline.model.contact.friction_elements import output_sliders
from pipeline.model.effects.effect import LOOPS, Conditions, Effect, Parameter
from pipeline.model.elements import Friction
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.load_cycle import ARCMIN

SHARES = np.array([0.25, 0.5, 0.75, 1.0])
"""Distances of the four equal elements, as shares of the last one's."""


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    torque, distance = 1e3 * values[0], values[1] / ARCMIN
    limit = np.full(len(SHARES), torque / len(SHARES))
    return drive.with_elements(Friction(output_sliders(drive.reducer, limit, distance * SHARES)))


EFFECT = Effect(
    name="presliding",
    title="friction that yields before it slides",
    physics="bristles of different reach bend before they slip: four elastic-slip elements in parallel",
    source="Iwan, J. Appl. Mech. 33 (1966) 893; Al-Bender et al., IEEE Trans. Autom. Control 50 (2005) 1883",
    parameters=(
        Parameter("torque_Nm", "N m", "friction torque once all slide, referred to the output"),
        Parameter("distance_arcmin", "arcmin", "rotation over which it is fully raised"),
    ),
    changes="four sliders on the rotation of the output",
    signature="branches part smoothly after a reversal; minor loops are lenses",
    confused_with=("coulomb", "contact_friction"),
    told_apart_by="minor loops about a constant load: presliding friction makes lenses of them",
    limit_case="coulomb",
    bounds=lambda drive: ((0.0, 0.5e-3 * drive.rated_torque), (0.1, 10.0)),
    apply=_apply,
    needs=frozenset({LOOPS}),
)
