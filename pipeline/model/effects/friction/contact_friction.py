"""Friction that grows with the load: pins on the flank."""

from collections.abc import Sequence

from pipeline.model.contact.friction_elements import pin_sliders
from pipeline.model.effects.effect import STILL, Conditions, Effect, Parameter
from pipeline.model.elements import Friction
from pipeline.model.load_history.drive import Drive


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    return drive.with_elements(Friction(pin_sliders(drive.reducer, drive.laws, values[0], drive.rated_torque)))


EFFECT = Effect(
    name="contact_friction",
    title="friction of the pins on the flank, proportional to the load",
    physics="every pin resists sliding along the flank by the coefficient of friction times its force; where a bench "
    "turns the crank by pitches, all pins slide on and their friction is in proportion to the torque (load_friction)",
    source="Coulomb; tangential stiffness after Mindlin, J. Appl. Mech. 16 (1949) 259",
    parameters=(Parameter("coefficient", "1", "coefficient of friction"),),
    changes="a slider at every pin, pressed by its force",
    signature="branches part the further the higher the load; no width at zero torque of its own",
    confused_with=("coulomb", "presliding", "load_friction"),
    told_apart_by="loops to a quarter, half and all of the load: their width tells friction that grows with it",
    bounds=lambda drive: ((0.0, 0.4),),
    apply=_apply,
    needs=frozenset({STILL}),
)
