"""The tables of the small study as pandas reads them."""

import pandas as pd
import pytest
from contract import CONTRACT, path_of


@pytest.fixture(scope="session")
def frames(outputs, runs):
    """Every table as pandas reads it from the path that the contract names."""
    return {table: pd.read_parquet(path_of(runs, table)) for table in CONTRACT}
