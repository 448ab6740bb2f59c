"""Tables over the turn: transmission error and its orders, forces on bearings, and what contacts bear under torque."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from pipeline import assembly, mounting
from pipeline.config.studies.study import Study
from pipeline.engine.table import Column, Columns, Table, columns_of_frame
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.response import CycleResponse
from pipeline.model.metrics.turn import FEWEST_ANGLES, TurnReadings
from pipeline.model.turn import LARGEST_SHEAR, held_forces, orders
from pipeline.model.units import UM_PER_MM
from stages.clearance import rigid_angles
from stages.tables.keys import CONTACT, CRANK, FORCE, PRESSURE, SAMPLE, labels, repeated_axes

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

    None where the angles are not even, or fewer than `FEWEST_ANGLES` to a turn of the crank, or where the cranks of a
    carrier do not come back after the study's turn.
    """
    held_torque, parts = assembly.definitions(study).rigidity_high, [pd.DataFrame(ORDERS.empty())]
    curves = (
        (0.0, readings.free_angle[..., readings.free_even]),
        (held_torque, readings.loaded_angle[..., readings.loaded_even]),
    )
    turns = study.cycle.crank_turns
    is_closed = turns > 1 or not study.design.output.carries_disks
    for torque, angle in (curve for curve in curves if is_closed and curve[1].shape[2] >= FEWEST_ANGLES * turns):
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
    return columns_of_frame(rows)


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


SHEAR = Column("shear_MPa", "float64", "MPa", "largest shear stress below any contact under the torque held")
SHEAR_DEPTH = Column("shear_depth_um", "float64", "um", "depth of the largest shear stress, where it is deepest")
PRESSURE_SPEED = Column(
    "pressure_speed_MPa_m_per_s", "float64", "MPa m/s", "largest pressure times sliding speed; null without a speed"
)
FRICTION_POWER = tuple(
    Column(f"friction_{sense}_W", "float64", "W", f"friction power of the contacts, torque held in the {sense} sense")
    for sense in ("plus", "minus")
)
RUNNING = (SHEAR, SHEAR_DEPTH, PRESSURE_SPEED, *FRICTION_POWER)
"""Columns of the table of loops."""
TURN_CONTACTS = Table(
    "turn_contacts",
    "kept sample, loaded crank, sense of the torque held, contact",
    (
        SAMPLE,
        CRANK,
        Column("torque_Nm", "float64", "N m", "torque held on the output: +- the higher one of the rigidity"),
        CONTACT,
        FORCE,
        PRESSURE,
        Column("shear_MPa", "float64", "MPa", "largest shear stress below the contact"),
        Column("shear_depth_um", "float64", "um", "its depth"),
        Column("sliding_m_per_s", "float64", "m/s", "sliding speed, on the disk or in the seat; null without a speed"),
        Column(
            "pressure_speed_MPa_m_per_s", "float64", "MPa m/s", "pressure times sliding speed; null without a speed"
        ),
    ),
)


def running_columns(study: Study, drive: Drive, response: CycleResponse) -> dict[str, np.ndarray]:
    """Columns of the table of loops (n,) at one crank angle."""
    force = held_forces(response, assembly.definitions(study))
    running = mounting.running(study.design, drive.reducer)
    power = running.friction_power(force)
    pressure = np.max(drive.laws_of_states.peak_pressure(force), axis=(1, 2))
    return {
        SHEAR.name: LARGEST_SHEAR * pressure,
        SHEAR_DEPTH.name: UM_PER_MM * np.max(running.shear_depth(drive.laws_of_states, force), axis=(1, 2)),
        PRESSURE_SPEED.name: np.max(running.pressure_speed(drive.laws_of_states, force), axis=(1, 2)),
        **{column.name: power[:, sense] for sense, column in enumerate(FRICTION_POWER)},
    }


def contacts_at_angle(
    study: Study, drive: Drive, response: CycleResponse, kept_states: np.ndarray
) -> dict[str, np.ndarray]:
    """Values (n_kept, 2, n_contacts) of the table of contacts over the turn at one crank angle."""
    force = held_forces(response, assembly.definitions(study))[kept_states]
    running, laws = mounting.running(study.design, drive.reducer), drive.some(kept_states).laws_of_states
    pressure = laws.peak_pressure(force)
    return {
        "force_N": force,
        "pressure_MPa": pressure,
        "shear_MPa": LARGEST_SHEAR * pressure,
        "shear_depth_um": UM_PER_MM * running.shear_depth(laws, force),
        "sliding_m_per_s": np.broadcast_to(1e-3 * running.speed, force.shape),
        "pressure_speed_MPa_m_per_s": running.pressure_speed(laws, force),
    }


def turn_contact_rows(study: Study, samples: np.ndarray, angles: Sequence[dict[str, np.ndarray]]) -> Columns:
    """Rows of the table of contacts over the turn, of kept ``samples`` at each loaded crank angle."""
    held_torque = assembly.definitions(study).rigidity_high
    contacts = np.arange(angles[0]["force_N"].shape[2])
    axes = samples, np.array(study.cycle.crank_deg), np.array([held_torque, -held_torque]), contacts
    keys = dict(zip(("sample", "crank_deg", "torque_Nm", "contact"), repeated_axes(*axes), strict=True))
    return keys | {name: np.stack([part[name] for part in angles], axis=1).ravel() for name in angles[0]}
