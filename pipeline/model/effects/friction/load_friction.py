"""Friction of the turning train, in proportion to the torque that it carries."""

from collections.abc import Sequence

from pipeline.model.contact.friction_elements import load_slider
from pipeline.model.effects.effect import SENSES, Conditions, Effect, Parameter
from pipeline.model.effects.friction.coulomb import DISTANCE
from pipeline.model.elements import Friction
from pipeline.model.load_history.drive import Drive


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    return drive.with_elements(Friction(load_slider(drive.reducer, values[0], drive.rated_torque, DISTANCE)))


EFFECT = Effect(
    name="load_friction",
    title="friction in proportion to the torque",
    physics="bearings, and pins that slide all along, resist turning in proportion to their load, which is in "
    "proportion to the torque: 1 - efficiency",
    source="frictional moment M = mu P d / 2 with a constant coefficient, SKF, Rolling bearings (2018)",
    parameters=(Parameter("coefficient", "1", "friction torque, referred to the output, over the torque carried"),),
    changes="a slider on the rotation of the output, its limit in proportion to the torque in the reducer",
    signature="branches part in proportion to the torque; after a reversal the angle stays where it is",
    confused_with=("contact_friction", "presliding"),
    told_apart_by="the same loop at two loads: its width is in proportion to the torque",
    bounds=lambda drive: ((0.0, 0.6),),
    apply=_apply,
    needs=frozenset({SENSES}),
)
