"""
A series of states
==================

One drive was measured in several states, here while its seals rub more and more. What do the states share, and what
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
shape = np.concatenate([np.linspace(0, 1, 16)[1:], np.linspace(1, -1, 32)[1:], np.linspace(-1, 0, 16)[1:]])
torque = 20.0 * np.sign(shape) * shape**2  # closer to one another about zero, where the play is taken up


def measured_loops(friction: float) -> pd.DataFrame:
    """Two loops at each of three crank angles; friction, play and spring scatter by 2 % between the angles."""
    rows = []
    for crank in (0.0, 120.0, 240.0):
        own_friction, play, compliance = np.array([friction, 1.0, 0.2]) * (1 + random.normal(0.0, 0.02, 3))
        for cycle in range(2):
            net, behind = 0.0, []
            for value in torque:  # what is left behind the friction
                net = min(max(net, value - own_friction), value + own_friction)
                behind.append(net)
            angle = compliance * np.array(behind) + play / 2 * np.tanh(np.array(behind) / 1.5)
            noise = random.normal(0.0, 0.03, len(torque))
            rows.append(
                pd.DataFrame({"cycle": cycle, "crank_deg": crank, "torque_Nm": torque, "angle_arcmin": angle + noise})
            )
    return pd.concat(rows)


# %%
# Four states whose friction grows by a third in each hundred hours.
folder = Path(tempfile.mkdtemp()) / "worn_drive"
for hours in range(0, 400, 100):
    state = folder / f"after_{hours}_h"
    state.mkdir(parents=True)
    (state / "unit.toml").write_text(UNIT.format(hours=hours))
    measured_loops(0.5 * (4 / 3) ** (hours / 100)).to_csv(state / "rows.csv", index=False)

answer = identify_series(folder, over="hours")
print(answer)

# %%
# The numbers of the loops over the hours: the change with one hour, as a share where the unit of the slope is 1.
columns = ["number", "slope_unit", "slope", "ci_low", "ci_high", "p_family"]
answer.table("trends")[columns].round(5)
