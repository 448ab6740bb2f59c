"""Friction without a memory: of seals and bearings, of the contacts, in proportion to the torque."""

from collections.abc import Sequence

import numpy as np

from pipeline.model.contact.friction_elements import load_slider, output_sliders, pin_sliders
from pipeline.model.effects.effect import SENSES, STILL, Conditions, Effect, Parameter
from pipeline.model.elements import Friction
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.load_cycle import ARCMIN

DISTANCE = 0.001 / ARCMIN
"""Rotation [rad] over which the friction rises: a thousandth of an arcmin, a tenth of the noise of precise benches."""


def _apply_coulomb(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    torque = np.array([1e3 * values[0]])
    return drive.with_elements(Friction(output_sliders(drive.reducer, torque, np.array([DISTANCE]))))


COULOMB = Effect(
    name="coulomb",
    title="constant friction of seals and bearings",
    physics="the turning end resists with a torque of constant size against its motion, whatever the load",
    source="Coulomb; Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083",
    parameters=(Parameter("torque_Nm", "N m", "friction torque, referred to the output"),),
    changes="a slider on the rotation of the output",
    signature="branches are apart by the same torque at every load; the width at zero torque grows",
    confused_with=("contact_friction", "presliding"),
    told_apart_by="a slow ramp to a tenth of the load: constant friction opens it as wide as the full one, and loops "
    "at another rate as wide as before; viscous friction grows with the rate, and loops of one rate do not tell it",
    bounds=lambda drive: ((0.0, 0.5e-3 * drive.rated_torque),),
    apply=_apply_coulomb,
    needs=frozenset({SENSES}),
)


def _apply_load_friction(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    return drive.with_elements(Friction(load_slider(drive.reducer, values[0], drive.rated_torque, DISTANCE)))


LOAD_FRICTION = Effect(
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
    apply=_apply_load_friction,
    needs=frozenset({SENSES}),
)


def _apply_directional_load_friction(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    loading, unloading = values
    rubbing = load_slider(drive.reducer, 0.5 * (loading + unloading), drive.rated_torque, DISTANCE)
    return drive.with_elements(Friction(rubbing, 0.5 * (loading - unloading)))


DIRECTIONAL_LOAD_FRICTION = Effect(
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
    apply=_apply_directional_load_friction,
    limit_case="load_friction",
    needs=frozenset({SENSES}),
)


def _apply_contact_friction(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    return drive.with_elements(Friction(pin_sliders(drive.reducer, drive.laws, values[0], drive.rated_torque)))


CONTACT_FRICTION = Effect(
    name="contact_friction",
    title="friction of the pins on the flank, proportional to the load",
    physics="every pin of the housing resists sliding along the flank by the coefficient of friction times its force; "
    "where a bench turns the crank by pitches, all pins slide on and their friction is in proportion to the torque "
    "(load_friction)",
    source="Coulomb; tangential stiffness after Mindlin, J. Appl. Mech. 16 (1949) 259",
    parameters=(Parameter("coefficient", "1", "coefficient of friction"),),
    changes="a slider at every pin, pressed by its force",
    signature="branches part the further the higher the load; no width at zero torque of its own",
    confused_with=("coulomb", "presliding", "load_friction"),
    told_apart_by="loops to a quarter, half and all of the load: their width shows friction that grows with it",
    bounds=lambda drive: ((0.0, 0.4),),
    apply=_apply_contact_friction,
    needs=frozenset({STILL}),
)

EFFECTS = (COULOMB, LOAD_FRICTION, DIRECTIONAL_LOAD_FRICTION, CONTACT_FRICTION)
