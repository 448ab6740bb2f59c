"""Columns that several tables share, the rows that carry them, and the condensed compliance that stages hand on."""

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import assembly
from pipeline.engine.table import Column
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.units import UM_PER_MM

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


COMPLIANCE_FILE = "compliance.npz"


def matrix_name(crank_deg: float, disk: int = 0) -> str:
    """Name of the matrix of one crank angle in ``compliance.npz``; of further disks with their number."""
    return f"crank_{crank_deg:.9g}" + (f"_disk_{disk}" if disk else "")


def full_compliance(path: Path, reducer: Reducer, crank_deg: float) -> np.ndarray:
    """Compliance (n_contacts, n_contacts) [mm/N] between all contacts: each disk's, and rigid bodies elsewhere."""
    full = np.zeros((len(reducer.contacts), len(reducer.contacts)))
    with np.load(path) as matrices:
        for disk in range(reducer.n_disks):
            rows = assembly.disk_contacts(reducer, disk)
            full[np.ix_(rows, rows)] = matrices[matrix_name(crank_deg, disk)] / UM_PER_MM
    return full
