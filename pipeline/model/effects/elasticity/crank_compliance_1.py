"""Compliance of the output that varies once a turn of the crank."""

from pipeline.model.effects.effect import CRANKS, MOVES
from pipeline.model.effects.elasticity._crank_compliance import crank_compliance

EFFECT = crank_compliance(
    order=1,
    word="once",
    physics="one side of the housing or of the pins' seats gives way more than the other: as the crank turns, the load "
    "goes through softer and stiffer ones, once a turn",
    signature="loops are steeper at high torque at some crank angles than half a turn of the crank away",
    confused_with=("pin_circle_runout", "encoder_eccentricity"),
    told_apart_by="an unloaded turn of the crank: no error there",
    needs={CRANKS, MOVES},
)
