"""The figure of the loop: its arrows are the widths that the metrics are."""

import numpy as np
import pandas as pd
import pytest

from pipeline.figures.hysteresis import hysteresis_figure
from pipeline.model.metrics import Definitions


@pytest.mark.parametrize(("friction", "name"), [(0.0, "clearance\nbacklash"), (0.2, "zero-torque\nwidth")])
def test_the_arrows_are_the_width_at_zero_torque_and_the_lost_motion_of_the_centre_lines(friction, name):
    """A play of 2 arcmin, 0.5 arcmin/(N m), and friction that shifts each branch by its torque."""
    parts = []
    for branch, torque in (
        ("loading+", np.linspace(0, 12, 61)),
        ("unloading+", np.linspace(12, 0, 61)),
        ("loading-", np.linspace(0, -12, 61)),
        ("unloading-", np.linspace(-12, 0, 61)),
        ("loading+", np.linspace(0, 12, 61)),
    ):
        side = 1.0 if branch.endswith("+") else -1.0
        rising = np.sign(torque[-1] - torque[0])
        angle = side + 0.5 * (torque - rising * friction)
        parts.append(pd.DataFrame({"branch": branch, "torque_Nm": torque, "angle_arcmin": angle}))
    figure = hysteresis_figure({"nominal": pd.concat(parts)}, marks=Definitions(0.4, 6.0, 12.0))
    middle = figure.axes[1]
    texts = [text for text in middle.texts if text.get_text()]
    assert [text.get_text() for text in texts] == [name, "lost\nmotion"]
    heights = [abs(note.xy[1] - note.xyann[1]) for note in middle.texts if not note.get_text()]
    assert heights == pytest.approx([2.0 + friction, 2.0 + 2 * 0.5 * 0.4])
