"""
A series of states
==================

One drive was measured in several states, here with more and more wear. What do the states share, and what
follows the number of hours? Each state is a folder with its own ``unit.toml``; ``[state]`` has the value that
orders them.
"""

import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import identify_series

UNIT = """
title = "After {hours} hours"
locked = "input"
offset = "per_position"
[generic]
ratio = 30.0
rated_torque_Nm = 20.0
[state]
values = {{hours = {hours}}}
"""
random = np.random.default_rng(7)
torque = np.concatenate([np.linspace(0, 20, 15), np.linspace(20, -20, 30), np.linspace(-20, 0, 15)])


def measured_loops(play: float, friction: float) -> pd.DataFrame:
    """Three loops at each of three crank angles; play, friction and stiffness scatter by 2 % between the angles."""
    rows = []
    sense = np.sign(np.diff(torque, append=torque[-1] + 1e-9))
    for crank in (0.0, 120.0, 240.0):
        scatter = 1 + random.normal(0.0, 0.02, 3)
        for cycle in range(3):
            net = torque - sense * friction * scatter[0]
            angle = net / 5.0 * scatter[1] + np.sign(net) * play * scatter[2] / 2 * np.minimum(1, np.abs(net) / 0.2)
            noise = random.normal(0.0, 0.01, len(torque))
            rows.append(
                pd.DataFrame({"cycle": cycle, "crank_deg": crank, "torque_Nm": torque, "angle_arcmin": angle + noise})
            )
    return pd.concat(rows)


# %%
# Six states whose play grows by a fifth in each hundred hours.
folder = Path(tempfile.mkdtemp()) / "worn_drive"
for hours in range(0, 600, 100):
    state = folder / f"after_{hours}_h"
    state.mkdir(parents=True)
    (state / "unit.toml").write_text(UNIT.format(hours=hours))
    measured_loops(1.2 ** (hours / 100), 0.5).to_csv(state / "rows.csv", index=False)

answer = identify_series(folder, over="hours")
print(answer)

# %%
answer.to_frame().round(3)
