"""The condensed compliance as the stages hand it on: written by reduce, read by hysteresis."""

from pathlib import Path

import numpy as np

from pipeline import assembly
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.units import UM_PER_MM

COMPLIANCE_FILE = "compliance.npz"


def matrix_name(crank_deg: float, disk: int = 0) -> str:
    """Name of the matrix of one crank angle in ``compliance.npz``; of further disks with their number."""
    return f"crank_{crank_deg:.9g}" + (f"_disk_{disk}" if disk else "")


def full_compliance(path: Path, reducer: Reducer, crank_deg: float) -> np.ndarray:
    """Compliance (n_contacts, n_contacts) [mm/N] between all contacts: each disk's, and rigid bodies elsewhere."""
    with np.load(path) as matrices:
        blocks = [matrices[matrix_name(crank_deg, disk)] / UM_PER_MM for disk in range(reducer.n_disks)]
    return assembly.joined_blocks(reducer, blocks)
