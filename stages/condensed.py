"""The condensed compliance as the stages hand it on: written by reduce, read by hysteresis."""

from pathlib import Path

import numpy as np

from pipeline import assembly
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.units import UM_PER_MM

COMPLIANCE_FILE = "compliance.npz"


def matrix_name(crank_deg: float) -> str:
    """Name of the matrix of one crank angle in ``compliance.npz``."""
    return f"crank_{crank_deg:.9g}"


def full_compliance(path: Path, at: Reducer, crank_deg: float) -> np.ndarray:
    """Compliance (n_contacts, n_contacts) [mm/N] between all contacts: the disk's, and rigid bodies elsewhere."""
    rows = assembly.disk_contacts(at)
    full = np.zeros((len(at.contacts), len(at.contacts)))
    with np.load(path) as matrices:
        full[np.ix_(rows, rows)] = matrices[matrix_name(crank_deg)] / UM_PER_MM
    return full
