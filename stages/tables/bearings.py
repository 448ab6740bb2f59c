"""The forces on the disks' bearings over the turn, and the disks' shares of the torque: their table and its rows."""

from collections.abc import Mapping

import numpy as np

from pipeline import assembly
from pipeline.config.studies.study import Study
from pipeline.engine.table import Column, Columns, Table
from stages.tables.keys import CRANK, SAMPLE, repeated_axes

BEARINGS = Table(
    "bearings",
    "sample, crank, disk, bearing, sense of the torque held",
    (
        SAMPLE,
        CRANK,
        Column("disk", "int32", "1", "disk whose bearing it is"),
        Column("bearing", "int32", "1", "0: input bearing; with a carrier: crank whose bearing in the disk it is"),
        Column("torque_Nm", "float64", "N m", "torque held on the output: +- the higher one of the rigidity"),
        Column("force_x_N", "float64", "N", "force of the disk on the bearing, housing frame"),
        Column("force_y_N", "float64", "N", "force of the disk on the bearing, housing frame"),
        Column("torque_share", "float64", "1", "share of the disk in the torque on the output"),
    ),
)


def bearing_rows(study: Study, samples: np.ndarray, thrust: np.ndarray, shares: np.ndarray) -> Columns:
    """Rows of the table of bearings of ``samples`` (n,).

    Parameters
    ----------
    thrust : (n, 2, n_angles, n_bearings) complex [N], disk after disk.
    shares : of the disks in the torque (n, 2, n_angles, n_disks).
    """
    held_torque = assembly.definitions(study).rigidity_high
    of_a_disk = thrust.shape[3] // shares.shape[3]
    axes = samples, np.array(study.cycle.crank_deg), np.arange(thrust.shape[3]), np.array([held_torque, -held_torque])
    sample, crank, number, torque = repeated_axes(*axes)
    disk, bearing = np.divmod(number, of_a_disk)
    force = np.moveaxis(thrust, 1, 3).ravel()
    keys = {"sample": sample, "crank_deg": crank, "disk": disk, "bearing": bearing, "torque_Nm": torque}
    share = np.repeat(np.moveaxis(shares, 1, 3), of_a_disk, axis=2).ravel()
    return {**keys, "force_x_N": force.real.copy(), "force_y_N": force.imag.copy(), "torque_share": share}


def bearing_forces(columns: Mapping[str, np.ndarray], n_angles: int) -> np.ndarray:
    """Forces (n, 2, n_angles, n_bearings) complex [N] read back from rows of the table of bearings."""
    force = columns["force_x_N"] + 1j * columns["force_y_N"]
    n_bearings = (int(columns["disk"].max()) + 1) * (int(columns["bearing"].max()) + 1)
    return np.moveaxis(force.reshape(-1, n_angles, n_bearings, 2), 3, 1)
