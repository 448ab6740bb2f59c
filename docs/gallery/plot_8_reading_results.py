"""
Reading results with pandas, polars and DuckDB
==============================================

Every table of a run is one Parquet file or a folder of parts. The name of a column ends in its unit.
"""

import duckdb
import polars as pl
from small import small_study

from pipeline import parts, run

finished = run(small_study("gallery_reading"), ["aggregate"])
folder = finished.folder

# %%
# pandas: worst, mean and best of each unit over the turn.
finished.table("aggregate/units").filter(like="lost_motion").describe().round(3)

# %%
# polars reads only the columns that the query needs.
files = parts(folder, "aggregate/units")
print(pl.scan_parquet(files).select(pl.col("^.*_arcmin_worst$").quantile(0.95)).collect())

# %%
# DuckDB: the largest pin force of each unit whose contacts were kept.
contacts = parts(folder, "hysteresis/contacts")
print(
    duckdb.sql(
        "SELECT sample, max(force_N) AS largest_N FROM read_parquet($files) GROUP BY sample ORDER BY sample",
        params={"files": contacts},
    )
)
