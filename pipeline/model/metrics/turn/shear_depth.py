"""Depth of the largest shear stress below the contacts."""

import numpy as np

from pipeline.model.metrics.turn.turn_metric import TurnMetric

TURN_METRIC = TurnMetric(
    name="shear_depth_um",
    title="Depth of the largest shear",
    unit="µm",
    definition="Depth at which the shear stress below a contact is largest, 0.786 of Hertz' half width: of the contact "
    "in which it lies deepest over the loaded crank angles under {rigidity_high:g} N m.",
    rank=5,
    decimals=0,
    value=lambda turn: np.max(turn.shear_depth, axis=1),
)
