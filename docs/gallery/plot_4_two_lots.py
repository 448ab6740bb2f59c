"""
Two suppliers' lots
===================

Two suppliers deliver disks; a sample of each lot was measured. Which yield follows from each? A distribution is fitted
to each lot, the study is solved with it, and the two are compared on the same random numbers.
"""

import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
from small import small_study

from pipeline import lots

random = np.random.default_rng(1)
folder, files = Path(tempfile.mkdtemp()), []
for supplier, shift_um in (("supplier_a", 0.0), ("supplier_b", 4.0)):
    lot = pd.DataFrame({"part": np.arange(25), "disk_profile_um": random.triangular(10.0, 11.0, 14.0, 25) + shift_um})
    files.append(folder / f"{supplier}.csv")
    lot.to_csv(files[-1], index=False)

# %%
# The answer in sentences: the yield of each lot beside that of the tolerances as drawn.
answer = lots(files, small_study("gallery_lots"), units=60, jobs=1)
print(answer)

# %%
# The fitted distributions, and the yields by limit.
answer.table("fits").round(3).T

# %%
answer.table("yields").round(3)
