"""Friction in proportion to the load that differs between drive and backdrive."""

from collections.abc import Sequence

from pipeline.model.contact.friction_elements import load_slider
from pipeline.model.effects.effect import SENSES, Conditions, Effect, Parameter
from pipeline.model.effects.friction.coulomb import DISTANCE
from pipeline.model.elements import Friction
from pipeline.model.load_history.drive import Drive


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    loading, unloading = values
    rubbing = load_slider(drive.reducer, 0.5 * (loading + unloading), drive.rated_torque, DISTANCE)
    return drive.with_elements(Friction(rubbing, 0.5 * (loading - unloading)))


EFFECT = Effect(
    name="directional_load_friction",
    title="load friction that differs between drive and backdrive",
    physics="the efficiency of a train is not that of its reverse: while the output turns with the torque on it, T = "
    "(1 + a) carried, while it turns back against it, T = (1 - b) carried",
    source="directional efficiency of geared transmissions, Wang and Kim, IEEE ICRA (2015) 1055",
    parameters=(
        Parameter("loading", "1", "friction torque over the torque carried while the load rises"),
        Parameter("unloading", "1", "the same while the load falls"),
    ),
    changes="a slider on the output, its limits in proportion to the torque in the reducer and unlike in both senses",
    signature="branches part in proportion to the torque, and lie unevenly about the curve without friction",
    confused_with=("load_friction", "torque_gain"),
    told_apart_by="the efficiency in both directions at the same torque, from input to output and back",
    bounds=lambda drive: ((0.0, 0.6), (0.0, 0.6)),
    apply=_apply,
    limit_case="load_friction",
    needs=frozenset({SENSES}),
)
