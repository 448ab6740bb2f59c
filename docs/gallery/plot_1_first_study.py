"""
First study
===========

How many units meet their limits, and which tolerance drives each metric? A study is loaded by its name, run,
and read as pandas tables. ``make study STUDY=quick`` does the same and writes one HTML page.
"""

from matplotlib import pyplot as plt
from small import small_study

from pipeline import draw_distribution, draw_loop, run

study = small_study("gallery_first")
finished = run(study, ["aggregate"])

# %%
# The yield against each limit, with its 95 % interval.
distributions = finished.table("aggregate/distributions")
yields = distributions.query("statistic == 'yield' and over == 'worst'")
yields[["metric", "value", "ci_low", "ci_high", "n"]].round(3)

# %%
# The distribution of the lost motion, and the loop of the nominal reducer.
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.5), layout="constrained")
draw_distribution(finished, "lost_motion_arcmin", left)
draw_loop(finished, right, sample=0)

# %%
# The errors that go with the lost motion most: rank correlations with intervals.
ranks = finished.table("aggregate/sensitivity").query("kind == 'rank_correlation' and metric == 'lost_motion_arcmin'")
ranks.sort_values("index", key=abs, ascending=False)[["parameter", "index", "ci_low", "ci_high"]].head(5).round(2)
