"""One unit over a turn of the output: as many crank turns as the disk has lobes, each pin against each lobe.

The pins' pattern about the eccentric repeats with every pitch of the pins. In the disk's frame it is then the same
turned by a lobe, and so is a disk of equal sectors: what it gives way between pins at any such crank angle is known
from one condensation. Only a slide does not turn with the pattern; it is condensed at all lobes together with it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import gcd

import numpy as np
from numpy.typing import NDArray

from pipeline import assembly
from pipeline.config.study import Study
from pipeline.elastic import disk_patches, elastic_disk
from pipeline.model.elastic.condensed_body import ElasticBody
from pipeline.model.elastic.pressure_patches import joined, turned
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.geometry.rigid_backlash import rigid_play
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.load_cycle import LoadCycle
from pipeline.model.load_history.response import respond
from pipeline.model.units import ARCMIN
from pipeline.mounting import drive_of
from pipeline.sampling import Errors

Real = NDArray[np.float64]
PHASES = 3
"""Phases of the pins' pitch that are condensed: the wave of the pitch itself is told from the mean of the turn."""
LOADED_PER_TURN = 30
"""Loaded crank angles a turn of the crank, or as few more as visit all phases alike."""
LOBES_AT_ONCE = 8
"""Lobes whose slides are condensed together: more take more memory and no less time."""
ARCSEC = 60 * ARCMIN
"""Seconds of arc in a radian."""


@dataclass(frozen=True)
class OutputTurn:
    """Transmission error of one unit over a turn of the output.

    Attributes
    ----------
    crank : (n_angles,) [rad], evenly over all crank turns, ascending.
    error : (2, n_angles) [arcsec], angle of the output less that of the nominal ratio in the senses + and -.
    """

    crank: Real
    error: Real


def rigid_cranks(study: Study) -> Real:
    """Crank angles [rad] evenly over the output turn, more than two to a pitch of the pins."""
    cycloid = study.design.cycloid
    per_turn = 2 * cycloid.pins + 1
    return 2 * np.pi * np.arange(per_turn * cycloid.lobes) / per_turn


def loaded_steps(study: Study) -> NDArray[np.intp]:
    """Steps of a pitch over ``PHASES`` at which the unit is loaded, evenly over the output turn, all phases alike."""
    cycloid = study.design.cycloid
    steps = cycloid.pins * cycloid.lobes * PHASES
    widest = max(1, cycloid.pins * PHASES // LOADED_PER_TURN)
    stride = next(k for k in range(widest, 0, -1) if steps % k == 0 and gcd(k, PHASES) == 1)
    return np.arange(0, steps, stride)


def free_error(study: Study, unit: Errors) -> OutputTurn:
    """Error of one unit at the ends of its play.

    Raises
    ------
    ArithmeticError
        If its contacts interfere at some crank angle: it has no play there.
    """
    cranks = rigid_cranks(study)
    ends = []
    for drive in _drives(study, unit, cranks):
        play = rigid_play(drive.reducer, drive.gap, drive.bearing_clearance)
        if play.preloaded[0]:
            at = np.degrees(drive.reducer.crank)
            raise ArithmeticError(f"contacts interfere at crank angle {at:.4g} degrees, so that there is no play")
        ends.append(play.ends)
    return OutputTurn(cranks, ARCSEC * np.concatenate(ends, axis=1))


def loaded_error(study: Study, unit: Errors) -> OutputTurn:
    """Error of one unit while the torque of the metrics is held; for disks without holes.

    Raises
    ------
    ArithmeticError
        If some crank angle has no equilibrium.
    """
    steps = loaded_steps(study)
    cranks = 2 * np.pi * steps / (study.design.cycloid.pins * PHASES)
    body = elastic_disk(study)
    disks = {int(phase): TurnedDisk.of(study, body, int(phase)) for phase in np.unique(steps % PHASES)}
    rated = assembly.NMM_PER_NM * study.design.cycloid.rated_torque_Nm
    cycle = LoadCycle(rated, np.array([study.metrics.rigidity_percent[1] / 100]))
    angles = np.empty((2, len(steps)))
    for k, (step, crank) in enumerate(zip(steps, cranks, strict=True)):
        pitches, phase = divmod(int(step), PHASES)
        (drive,) = _drives(study, unit, np.array([crank]), disks[phase].compliance(pitches))
        response = respond(drive, cycle)
        if not response.converged[0]:
            raise ArithmeticError(f"no equilibrium at crank angle {np.degrees(crank):.4g} degrees")
        ends = [np.flatnonzero(response.torque == torque)[-1] for torque in cycle.state_torque[[1, 3]]]
        angles[:, k] = ARCSEC * response.angle[0, ends]
    return OutputTurn(cranks, angles)


def symmetric(study: Study) -> bool:
    """Whether the disk repeats from lobe to lobe: a single elastic one without holes."""
    reducer = assembly.reducer(study.design, 0.0)
    return reducer.n_disks == 1 and study.reduce.disk == "elastic" and not np.any(reducer.contacts.hole >= 0)


def _drives(study: Study, unit: Errors, cranks: Real, compliance: Real | None = None) -> Iterator[Drive]:
    errors = assembly.errors(unit)
    clearance = assembly.bearing_clearance(study.design, unit.bearing_clearance)
    laws = assembly.contact_laws(study, assembly.reducer(study.design, 0.0)) if compliance is None else None
    for crank in cranks:  # the play of rigid bodies knows no law: those of one angle do for all
        yield drive_of(study, float(np.degrees(crank)), compliance, errors, clearance, laws)


@dataclass(frozen=True)
class TurnedDisk:
    """A disk of equal sectors at one phase of the pins' pitch, condensed for all lobes.

    Attributes
    ----------
    at : the reducer at a crank angle of that phase.
    blocks : (n_lobes, n_rows, n_rows) [mm/N] compliance between `disk_contacts`, the slide turned back by 0, 1, ...
        lobes.
    """

    at: Reducer
    blocks: Real

    @classmethod
    def of(cls, study: Study, disk: ElasticBody, phase: int) -> "TurnedDisk":
        """Condense the pins once with the slide at every lobe."""
        cycloid = study.design.cycloid
        at = assembly.reducer(study.design, 360.0 * phase / (cycloid.pins * PHASES))
        patches = disk_patches(study, disk, at)
        slide = np.arange(at.n_pins, len(patches))
        blocks = []
        for start in range(0, cycloid.lobes, LOBES_AT_ONCE):
            lobes = np.arange(start, min(start + LOBES_AT_ONCE, cycloid.lobes))
            back = np.exp(-2j * np.pi * lobes / cycloid.lobes)
            slides = [turned(disk.mesh, patches.some(slide), turn) for turn in back]
            matrix = disk.compliance(joined(patches.some(np.arange(at.n_pins)), *slides)).matrix
            for k in range(len(lobes)):
                rows = np.concatenate([np.arange(at.n_pins), slide + k * len(slide)])
                blocks.append(matrix[np.ix_(rows, rows)])
        return cls(at, np.array(blocks))

    def compliance(self, pitches: int) -> Real:
        """Compliance (n_contacts, n_contacts) [mm/N] between all contacts after so many pitches of the pins.

        Notes
        -----
        A pin stands then where the one that many places on stood, in the pattern that has turned by as many lobes.
        """
        n_pins, n_contacts = self.at.n_pins, len(self.at.contacts)
        rows = assembly.disk_contacts(self.at)
        order = np.concatenate([(np.arange(n_pins) + pitches) % n_pins, np.arange(n_pins, len(rows))])
        full = np.zeros((n_contacts, n_contacts))
        full[np.ix_(rows, rows)] = self.blocks[pitches % len(self.blocks)][np.ix_(order, order)]
        return full
