"""One unit over a turn of the output: as many crank turns as the disk has lobes, each pin against each lobe.

Under load the disks are those of ``turn_drives``: condensed once for each phase of a pitch where they repeat from lobe
to lobe, else once for each pitch between two equal directions of the eccentric in the disk.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import gcd

import numpy as np

from pipeline import assembly
from pipeline.arrays import Index, Real
from pipeline.config.studies.study import Study
from pipeline.model.geometry.clearance import Errors as ModelErrors
from pipeline.model.geometry.clearance import after_turns
from pipeline.model.geometry.contacts import OUTPUT
from pipeline.model.geometry.drawn_flank import deviation_table
from pipeline.model.geometry.rigid_play.rigid_backlash import rigid_play
from pipeline.model.load_history.response import respond
from pipeline.model.turn import bearing_force, held_forces
from pipeline.model.units import ARCMIN, NMM_PER_NM
from pipeline.mounting import drive_of
from pipeline.populations.turn_drives import TurnDrives, Units
from pipeline.sampling.errors import Errors

Advance = Callable[[int, int], None]
"""Counts items that are done, and those of them without a result."""
PHASES = 3
"""Phases of the pins' pitch that are condensed: the wave of the pitch itself is told from the mean of the turn."""
LOADED_PER_TURN = 30
"""Loaded crank angles a turn of the crank, or as few more as visit all phases alike."""
PROBE_DEG = 47.0
"""Crank angle [degrees], of no symmetry, at which it is seen what a turn of the crank leaves as it was."""
SAME_LENGTH = 1e-9
"""Arms and gaps [mm] and directions [-] that differ by less are the same."""
ARCSEC = 60 * ARCMIN
"""Seconds of arc in a radian."""


@dataclass(frozen=True)
class OutputTurn:
    """Transmission error of one unit over a turn of the output.

    Attributes
    ----------
    crank : (n_angles,) [rad], evenly over all crank turns, ascending.
    error : (2, n_angles) [arcsec], angle of the output less that of the nominal ratio in the senses + and -.
    bearing_force, pin_force : (2, n_angles) [N] of the disk on its input bearing and of the first pin's contact;
        missing without a torque.
    """

    crank: Real
    error: Real
    bearing_force: Real
    pin_force: Real


def rigid_cranks(study: Study) -> Real:
    """Crank angles [rad] evenly over the output turn, more than two to a pitch of the pins."""
    cycloid = study.design.cycloid
    per_turn = 2 * cycloid.pins + 1
    return 2 * np.pi * np.arange(per_turn * cycloid.lobes) / per_turn


def loaded_steps(study: Study, phases: int = PHASES) -> Index:
    """Steps of a pitch over its ``phases`` at which the unit is loaded, evenly over the output turn, phases alike."""
    cycloid = study.design.cycloid
    steps = cycloid.pins * cycloid.lobes * phases
    widest = max(1, cycloid.pins * phases // LOADED_PER_TURN)
    stride = next(k for k in range(widest, 0, -1) if steps % k == 0 and gcd(k, phases) == 1)
    return np.arange(0, steps, stride)


def free_error(study: Study, unit: Errors, advance: Advance = lambda items, failed_items: None) -> OutputTurn:
    """Error of one unit at the ends of its play.

    Parameters
    ----------
    advance : called with the number of ``rigid_cranks`` that are done each time, and 0.

    Notes
    -----
    Where the output's contacts lie alike after a turn of the crank, and no bearing is loose, the unit after 0, 1, ...
    turns is so many units at one crank angle, with other lobes at the pins.

    Raises
    ------
    ArithmeticError
        If its contacts interfere at some crank angle: rigid bodies have no place there.
    """
    cranks, lobes = rigid_cranks(study), study.design.cycloid.lobes
    laws = assembly.contact_laws(study, assembly.reducer(study.design, 0.0))  # rigid bodies know none: any will do
    errors, clearance = _mounted_unit(study, unit)
    per_turn = len(cranks) // lobes
    one_batch = per_turn * lobes == len(cranks) and _turns_alike(study) and not np.any(clearance)
    if one_batch:
        errors, clearance = after_turns(errors, lobes), np.repeat(clearance, lobes, axis=0)
    ends = []
    for crank in np.degrees(cranks[:per_turn] if one_batch else cranks):
        drive = drive_of(study, float(crank), None, errors, clearance, laws)
        play = rigid_play(drive.reducer, drive.gap, drive.bearing_clearance)
        if np.any(play.preloaded):
            crank_deg = crank + 360.0 * np.argmax(play.preloaded)
            raise ArithmeticError(
                f"contacts interfere at crank angle {crank_deg:.6g} degrees, so that rigid bodies have no place there"
            )
        ends.append(play.ends)
        advance(lobes if one_batch else 1, 0)
    error = ARCSEC * np.stack(ends, axis=2).reshape(2, -1)
    missing = np.full(error.shape, np.nan)
    return OutputTurn(cranks, error, missing, missing)


def _turns_alike(study: Study) -> bool:
    """Whether a turn of the crank leaves one disk's flank and the output's contacts as they lie to each other.

    Cranks, planets and sun of a carrier turn against it by no whole number of turns.
    """
    profile, design = assembly.profile(study.design), study.design
    if (
        design.disk.count > 1
        or design.output.carries_disks
        or (profile.modification.deviates and len(deviation_table(profile)) > 1)
    ):
        return False
    lists = [assembly.reducer(study.design, crank).contacts for crank in (PROBE_DEG, PROBE_DEG + 360.0)]
    first_angle, second_angle = (part.some(part.kind == OUTPUT) for part in lists)
    sides = [part.normal * np.conj(part.normal[:1]) for part in (first_angle, second_angle)]
    pairs = ((first_angle.arm, second_angle.arm), (first_angle.gap, second_angle.gap), sides)
    return all(np.allclose(row_before, row_after, rtol=0, atol=SAME_LENGTH) for row_before, row_after in pairs)


def _mounted_unit(study: Study, unit: Errors) -> tuple[ModelErrors, Real]:
    """The errors of the unit and the clearance of its bearings, as the model takes them [mm]."""
    return assembly.errors(unit), assembly.bearing_clearance(study.design, unit.bearing_clearance)


def loaded_error(drives: TurnDrives, unit: Errors, advance: Advance = lambda items, failed_items: None) -> OutputTurn:
    """Error of one unit while the torque of the metrics is held.

    Parameters
    ----------
    advance : called after each of the ``loaded_steps`` with 1 and 0.

    Raises
    ------
    ArithmeticError
        If some crank angle has no equilibrium.
    """
    study, units = drives.study, Units.from_errors(drives.study, unit)
    steps, torques = loaded_steps(study, drives.phases), assembly.definitions(study)
    held_torque = NMM_PER_NM * torques.rigidity_high
    angles, on_bearing, on_pin = np.empty((3, 2, len(steps)))
    for k, step in enumerate(steps):
        drive = drives.drive(int(step), units)
        response = respond(drive, drives.cycle)  # lower torques lead to the one held: straight to it costs 6 times
        if not response.converged[0]:
            raise ArithmeticError(f"no equilibrium at crank angle {drives.crank_deg(int(step)):.4g} degrees")
        ends = [np.flatnonzero(np.isclose(response.torque, sense * held_torque))[-1] for sense in (1, -1)]
        angles[:, k] = ARCSEC * response.angle[0, ends]
        on_bearing[:, k] = np.abs(bearing_force(drive, response, torques)[0, :, 0])
        on_pin[:, k] = held_forces(response, torques)[0, :, 0]
        advance(1, 0)
    return OutputTurn(np.radians(drives.crank_deg(steps)), angles, on_bearing, on_pin)
