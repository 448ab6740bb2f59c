"""The figure of the command ``turn``: what its panels are named after."""

import numpy as np
import pandas as pd

from pipeline.figures.hysteresis import output_turn_figure


def test_the_panel_of_the_bearing_has_its_name():
    crank = np.arange(0.0, 1080.0, 90.0)
    rows = pd.concat(
        pd.DataFrame(
            {"sense": sense, "crank_deg": crank, "error_arcsec": 1.0, "bearing_force_N": 10.0, "pin_force_N": 2.0}
        )
        for sense in ("+", "-")
    )
    waves = pd.DataFrame({"sense": ["+", "-"], "order_of_crank": 1.0, "amplitude_arcsec": 2.0})
    figure = output_turn_figure({"200 N m held": rows}, {"200 N m held": waves}, 3, "bearing of a crank")
    titles = [axes.get_title() or axes.get_title("left") for axes in figure.axes]
    assert {"Bearing of a crank", "Pin 0"} <= set(titles)
