"""
A sweep in Python
=================

A study is changed by dotted keys and is checked as its file would be. Runs that share a mesh share its
condensation, so a sweep over tolerances condenses the disk once.
"""

import pandas as pd
from matplotlib import pyplot as plt
from small import small_study

from pipeline import run

rows = []
for allowance_um in (6.0, 9.0, 12.0):
    study = small_study(f"gallery_sweep_{allowance_um:g}", tolerances__disk_profile__allowance_um=allowance_um)
    units = run(study, ["aggregate"]).units
    rows.append(
        {"allowance_um": allowance_um, **units.filter(like="_worst").mean(), "preloaded": units["preloaded"].mean()}
    )
table = pd.DataFrame(rows).set_index("allowance_um")
table.round(3).T

# %%
# More allowance on the disk gives more play and fewer preloaded units.
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
table[["clearance_backlash_arcmin_worst", "lost_motion_arcmin_worst"]].plot(
    ax=left, marker="o", ylabel="mean worst (arcmin)"
)
(100 * table["preloaded"]).plot(ax=right, marker="o", ylabel="preloaded units (%)")
