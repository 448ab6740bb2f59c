"""Tables over the turn: transmission error and its orders, forces on the disks' bearings."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from pipeline import assembly
from pipeline.config.studies.study import Study
from pipeline.engine.table import Column, Columns, Table
from pipeline.model.metrics.turn import FEWEST_ANGLES, TurnReadings
from pipeline.model.turn import orders
from stages.clearance import rigid_angles
from stages.tables.keys import CRANK, SAMPLE, labels, repeated_axes

ARCSEC_PER_ARCMIN = 60.0
"""Seconds of arc in a minute of arc."""
SENSES = ("+", "-")
SENSE = Column("sense", "label", "", "+ or -: of the torque held, or the end of the play")
TORQUE = Column("torque_Nm", "float64", "N m", "torque held on the output; 0: the end of the play in that sense")

TRANSMISSION = Table(
    "transmission",
    "sample, sense, torque, loaded crank",
    (
        SAMPLE,
        SENSE,
        TORQUE,
        CRANK,
        Column("error_arcsec", "float64", "arcsec", "angle of the output less that of the nominal ratio"),
        Column("bearing_force_N", "float64", "N", "largest force of a disk on a bearing; null without torque"),
    ),
)
ORDERS = Table(
    "orders",
    "sample, sense, torque, order",
    (
        SAMPLE,
        SENSE,
        TORQUE,
        Column("order", "float64", "1", "waves of the transmission error per turn of the crank"),
        Column("amplitude_arcsec", "float64", "arcsec", "amplitude a of a cos(order crank + phase)"),
        Column("phase_deg", "float64", "deg", "phase, likewise"),
    ),
)


def transmission_rows(study: Study, samples: np.ndarray, readings: TurnReadings) -> Columns:
    """Rows of the table of the transmission error."""
    held_torque = assembly.definitions(study).rigidity_high
    at_loaded = np.isin(rigid_angles(study), study.cycle.crank_deg)
    angle = np.stack([readings.free_angle[..., at_loaded], readings.loaded_angle], axis=2)  # (n, sense, torque, angle)
    force = np.full(angle.shape, np.nan)
    force[:, :, 1] = np.max(np.abs(readings.bearing_force), axis=3)
    sample, sense, share, crank = repeated_axes(
        samples, np.arange(2), np.array([0.0, 1.0]), np.array(study.cycle.crank_deg)
    )
    return {
        "sample": sample,
        "sense": labels(sense, SENSES),
        "torque_Nm": held_torque * share * np.where(sense == 0, 1.0, -1.0),
        "crank_deg": crank,
        "error_arcsec": ARCSEC_PER_ARCMIN * angle.ravel(),
        "bearing_force_N": force.ravel(),
    }


def order_rows(study: Study, samples: np.ndarray, readings: TurnReadings) -> Columns:
    """Rows of the table of orders: of the play from the angles of rigid bodies, under load from the loaded ones.

    None where the angles are not even, or fewer than `FEWEST_ANGLES` to a turn of the crank.
    """
    held_torque, parts = assembly.definitions(study).rigidity_high, [pd.DataFrame(ORDERS.empty())]
    curves = (
        (0.0, readings.free_angle[..., readings.free_even]),
        (held_torque, readings.loaded_angle[..., readings.loaded_even]),
    )
    turns = study.cycle.crank_turns
    for torque, angle in (curve for curve in curves if curve[1].shape[2] >= FEWEST_ANGLES * turns):
        harmonics = orders(ARCSEC_PER_ARCMIN * angle, turns)
        sample, sense, order = repeated_axes(samples, np.arange(2), harmonics.order)
        parts.append(
            pd.DataFrame(
                {
                    "sample": sample,
                    "sense": labels(sense, SENSES),
                    "torque_Nm": torque * np.where(sense == 0, 1.0, -1.0),
                    "order": order,
                    "amplitude_arcsec": harmonics.amplitude.ravel(),
                    "phase_deg": np.degrees(harmonics.phase).ravel(),
                }
            )
        )
    rows = pd.concat(parts).sort_values("sample", kind="stable")
    return {name: rows[name].array if name == "sense" else rows[name].to_numpy() for name in rows}


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
