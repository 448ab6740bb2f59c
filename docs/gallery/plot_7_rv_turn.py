"""
An RV turn
==========

An RV reducer has a planetary stage and several crankshafts that carry two disks. Its transmission error
repeats with the planets, the cranks and the pins: orders of the turn. The disks are rigid here, as in many published
models; ``"reduce.disk": "elastic"`` meshes them.
"""

from matplotlib import pyplot as plt

from pipeline import load_study, run

study = load_study("rv_two_disks").with_(
    {
        "name": "gallery_rv",
        "samples.count": 4,
        "cycle.turn": "crank",
        "cycle.crank_deg": [15.0 * k for k in range(24)],
        "cycle.levels_per_branch": 2,
        "reduce.disk": "rigid",
        "run.jobs": 1,
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
