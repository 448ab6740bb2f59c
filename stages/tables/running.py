"""What contacts bear while the torque is held: columns of the loops, and the contacts of kept samples over the turn."""

from collections.abc import Sequence

import numpy as np

from pipeline import assembly, operation
from pipeline.config.studies.study import Study
from pipeline.engine.table import Column, Columns, Table
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.response import CycleResponse
from pipeline.model.turn import LARGEST_SHEAR, held_forces
from pipeline.model.units import UM_PER_MM
from stages.tables.keys import CONTACT, CRANK, FORCE, PRESSURE, SAMPLE, repeated_axes

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
    running = operation.running(study.design, drive.reducer)
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
    running, laws = operation.running(study.design, drive.reducer), drive.some(kept_states).laws_of_states
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
