"""Shear stress below the contacts."""

import numpy as np

from pipeline.model.metrics.turn.turn_metric import TurnMetric

TURN_METRIC = TurnMetric(
    name="subsurface_shear_MPa",
    title="Shear stress below the surface",
    unit="MPa",
    definition="Largest shear stress below any contact over the loaded crank angles under {rigidity_high:g} N m: 0.300 "
    "of Hertz' peak pressure (smooth elastic line contact without friction).",
    rank=4,
    decimals=0,
    value=lambda turn: np.max(turn.shear, axis=1),
)
