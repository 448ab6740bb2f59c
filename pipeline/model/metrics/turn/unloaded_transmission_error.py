"""Transmission error without load."""

from pipeline.model.metrics.turn.turn_metric import TURN, TurnMetric, peak_to_peak

TURN_METRIC = TurnMetric(
    name="unloaded_transmission_error_arcsec",
    title="Transmission error without load",
    unit="arcsec",
    definition="Angle of the output less that of the nominal ratio at the end of its play in one sense: peak to peak "
    "over the turn, the larger of both senses. Between the loaded angles the end is that of rigid bodies.",
    rank=1,
    decimals=2,
    value=lambda turn: peak_to_peak(turn.free_angle),
    of_play=True,
    needs=(TURN,),
)
