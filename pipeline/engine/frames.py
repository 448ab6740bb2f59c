"""Tables of results that are no stage's: written as files, and returned as frames."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from pipeline.engine.store import write_atomic
from pipeline.engine.table import Columns, Table


def write_tables(
    tables: Mapping[Table, Columns | pd.DataFrame], folder: Path, as_csv: bool = False
) -> dict[str, pd.DataFrame]:
    """Write tables as Parquet, and as CSV if that is wanted, into ``folder``; their frames by name."""
    frames = {table.name: pd.DataFrame(columns) for table, columns in tables.items()}
    for table, columns in tables.items():
        frame = frames[table.name]
        if isinstance(columns, pd.DataFrame):
            columns = {name: frame[name].to_numpy() for name in frame} if len(frame) else table.empty()
        write_atomic(folder / f"{table.name}.parquet", table.part(columns).data)
        if as_csv:
            write_csv(frame, folder / f"{table.name}.csv")
    return frames


def write_csv(frame: pd.DataFrame, path: Path) -> None:
    """Write a frame as CSV with eight digits."""
    write_atomic(path, frame.to_csv(index=False, float_format="%.8g").encode())
