"""Transmission error under a torque that is held."""

from pipeline.model.metrics.turn.turn_metric import TURN, TurnMetric, peak_to_peak

TURN_METRIC = TurnMetric(
    name="transmission_error_arcsec",
    title="Transmission error under load",
    unit="arcsec",
    definition="Angle of the output less that of the nominal ratio while {rigidity_high:g} N m are held in one sense: "
    "peak to peak over the turn, the larger of both senses.",
    rank=0,
    decimals=2,
    value=lambda turn: peak_to_peak(turn.loaded_angle),
    needs=(TURN,),
)
