"""Compliance of the output that varies twice a turn of the crank."""

from pipeline.model.effects.effect import CRANKS, TORQUES
from pipeline.model.effects.elasticity._crank_compliance import crank_compliance

EFFECT = crank_compliance(
    order=2,
    word="twice",
    physics="bearings of the cranks, or what carries them, are not alike in all directions or in all cranks: as the "
    "eccentrics turn, the resultant of the pins loads softer and stiffer ones, twice a turn",
    signature="order 2 of the transmission error in proportion to the torque, of the torque's sign in either sense",
    confused_with=("ovality_2",),
    told_apart_by="the order 2 at several torques: that of an ovality does not grow in proportion to the torque",
    needs={CRANKS, TORQUES},
)
