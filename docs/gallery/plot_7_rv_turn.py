"""
An RV turn
==========

An RV reducer has a planetary stage and several crankshafts that carry two disks. Its transmission error
repeats with the planets, the cranks and the pins: orders of the turn.
"""

from matplotlib import pyplot as plt

from pipeline import load_study, run

study = load_study("rv_two_disks").with_(
    {
        "name": "gallery_rv",
        "samples.count": 4,
        "cycle.turn": "crank",
        "cycle.crank_deg": [0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0],
        "cycle.levels_per_branch": 2,
        "run.jobs": 2,
    }
)
finished = run(study, ["aggregate"])
transmission = finished.table("aggregate/transmission")
transmission.head()

# %%
# The angle error of the nominal reducer over the turn.
figure, axes = plt.subplots(figsize=(7, 3.5), layout="constrained")
for sample, rows in transmission.groupby("sample"):
    axes.plot(rows["crank_deg"], rows.iloc[:, -1], ".", label=f"unit {sample}")
axes.set(xlabel="crank angle (degrees)", ylabel=transmission.columns[-1])
axes.legend()

# %%
finished.table("aggregate/orders").head(10)
