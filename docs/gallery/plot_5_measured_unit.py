"""
From a measured unit to a cause
===============================

A measured unit is a folder with a ``unit.toml`` and its loops. The identification tries every effect of its
library and says which one the data support, how large it is, or that they do not decide. This unit was generated with
a constant friction; every fourth of its rows is used here, so that the example takes seconds. With all rows
(``make identify UNIT=friction_example``) the friction alone is named.
"""

import shutil
import tempfile
from pathlib import Path

import pandas as pd

from pipeline import identify, settings

measured = settings.ROOT / "data/measured/friction_example"
folder = Path(tempfile.mkdtemp()) / "fewer_rows"
shutil.copytree(measured, folder)
rows = pd.read_csv(measured / "rows.csv")
loops = rows.groupby(["crank_deg", "cycle"])
turning = rows["torque_Nm"].abs().round(6) == loops["torque_Nm"].transform(lambda torque: torque.abs().max()).round(6)
rows[turning | (loops.cumcount() % 4 == 0)].to_csv(folder / "rows.csv", index=False)

answer = identify(folder, jobs=1)
print(answer)

# %%
# The candidates, best first, as they were compared.
answer.to_frame().head(8)

# %%
# The page for people:
print(answer.report.name, answer.verdict)
