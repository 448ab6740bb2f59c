"""
From a measured unit to a cause
===============================

A measured unit is a folder with a ``unit.toml`` and its loops. The identification tries every effect of its
library and says which one the data support, how large it is, or that they do not decide.
"""

from pipeline import identify

answer = identify("friction_example", jobs=1)
print(answer)

# %%
# The candidates, best first, as they were compared.
answer.to_frame().head(8)

# %%
# The page for people:
print(answer.report.name, answer.verdict)
