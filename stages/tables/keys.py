"""Columns that several tables share, and the rows that carry them."""

import numpy as np
import pandas as pd

from pipeline.engine.table import Column

SAMPLE = Column("sample", "int32", "1", "number of the sample; 0 is the nominal reducer if the study says so")
CRANK = Column("crank_deg", "float64", "deg", "crank angle")
CONTACT = Column("contact", "int32", "1", "number of the contact, pins first, then output rollers")
FORCE = Column("force_N", "float64", "N", "contact force")
PRESSURE = Column("pressure_MPa", "float64", "MPa", "peak Hertz pressure")
STATUS = Column("status", "label", "", "ok, or why there is no result")


def repeated_axes(*axes: np.ndarray) -> list[np.ndarray]:
    """Values of each axis for the rows of a table that runs over all of them, the last one fastest."""
    return [grid.ravel() for grid in np.meshgrid(*axes, indexing="ij")]


def labels(codes: np.ndarray, names: tuple[str, ...]) -> pd.Categorical:
    """Label column from codes."""
    return pd.Categorical.from_codes(codes, categories=list(names))
