"""
Which tolerance to tighten
==========================

The table ``scales/yields`` has the estimated yield with one tolerance scaled from a quarter to
twice its limits. The first screen of the report shows the same numbers, and ``make allocate`` finds the
cheapest combination and checks it on new load-solved units.
"""

from matplotlib import pyplot as plt
from small import small_study

from pipeline import run

study = small_study("gallery_tighten", limits__peak_pressure_MPa=3300.0)
finished = run(study, ["aggregate", "scales"])
yields = finished.table("scales/yields").query("metric == 'all_limits'")
stated = finished.table("aggregate/distributions").query(
    "metric == 'all_limits' and over == 'worst' and statistic == 'yield'"
)
value, low, high = stated[["value", "ci_low", "ci_high"]].iloc[0]
print(f"yield as stated: {value:.3f} ({low:.3f} to {high:.3f})")

# %%
# Yield at each scale of the limits of each tolerance; the widest span is the tolerance that decides.
table = yields.pivot(index="tolerance", columns="scale", values="value")
table.assign(span=table.max(axis=1) - table.min(axis=1)).sort_values("span", ascending=False).round(3)

# %%
# The three that decide, with their intervals.
figure, axes = plt.subplots(figsize=(7, 3.5), layout="constrained")
spans = (table.max(axis=1) - table.min(axis=1)).nlargest(3)
for name in spans.index:
    rows = yields[yields["tolerance"] == name]
    axes.errorbar(rows["scale"], rows["value"], [rows["value"] - rows["ci_low"], rows["ci_high"] - rows["value"]],
                  marker="o", capsize=3, label=name)  # fmt: skip
axes.set(xlabel="scale of the limits", ylabel="yield against all limits")
axes.legend()
