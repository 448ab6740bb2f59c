"""
An RV turn
==========

An RV reducer has a planetary stage and several crankshafts that carry two disks. Its transmission error
repeats with the planets, the cranks and the pins: orders of the output's turn. The disks are rigid here, as in many
published models; ``"reduce.disk": "elastic"`` meshes them.
"""

from matplotlib import pyplot as plt

from pipeline import load_study, run

angles = 323  # at least eight in each of the 39 turns of the crank, and no common factor with the 40 pins
study = load_study("rv_two_disks").with_(
    {
        "name": "gallery_rv",
        "samples.count": 2,
        "cycle.crank_deg": [39 * 360.0 * k / angles for k in range(angles)],
        "cycle.levels_per_branch": 2,
        "reduce.disk": "rigid",
        "run.jobs": 1,
    }
)
finished = run(study, ["aggregate"])
transmission = finished.table("aggregate/transmission")
transmission.head()

# %%
# The error of the angle at the end of the play in one sense, over a turn of the output: nominal, and one unit.
free = transmission[(transmission["torque_Nm"] == 0) & (transmission["sense"] == "+") & (transmission["sample"] < 2)]
figure, axes = plt.subplots(figsize=(7, 3.5), layout="constrained")
for sample, rows in free.groupby("sample"):
    axes.plot(rows["crank_deg"] / 39, rows["error_arcsec"], label=f"unit {sample}")
axes.set(xlabel="output turn (degrees)", ylabel="error (arcsec)")
axes.legend()

# %%
# The largest orders without load.
orders = finished.table("aggregate/orders")
unloaded = orders[(orders["torque_Nm"] == 0) & (orders["sense"] == "+") & (orders["sample"] == 1)]
unloaded.sort_values("amplitude_arcsec", ascending=False).head(8)
