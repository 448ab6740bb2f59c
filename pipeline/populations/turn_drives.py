"""The drives of a study at every step of a turn of the output: condensed disks, laws and gaps of any unit there.

A step is a phase of a pitch of the pins. After a pitch the pins stand about the eccentric as before, each in the place
of the next one, and the disk has gone on by a lobe: laws and compliance are kept in the order of places about the
eccentric, once for each phase and lobe, and read in the order of the pins. After as many pitches as there are lobes the
whole drive has turned in the housing: it is the same one with the errors of other pins in their places, so that states
of many steps are solved together.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pipeline import assembly
from pipeline.arrays import Index, Real
from pipeline.config.studies.study import Study
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.geometry.clearance import Errors as ModelErrors
from pipeline.model.geometry.out_of_round import ORDERS
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.load_cycle import LoadCycle
from pipeline.model.load_history.loop_readings import loop_readings
from pipeline.model.load_history.response import CycleResponse, respond
from pipeline.model.load_history.validity import invalid_metrics
from pipeline.model.metrics import library
from pipeline.model.metrics.turn import READ_AT
from pipeline.model.turn import torque_shares
from pipeline.mounting import drive_of
from pipeline.sampling.errors import Errors

if TYPE_CHECKING:
    from pipeline.model.elastic.condensed_body import ElasticBody

Condense = Callable[[float], Sequence[Real]]
"""Crank angle [degrees] to the compliance of each disk between its contacts (n_rows, n_rows) [mm/N]."""
TURN_ANGLES = tuple(name for names in READ_AT for name in names)
"""Angles of a loop whose range over the turn is a transmission error."""
HOUSING_ERRORS = ("pin_radial", "pin_tangential", "pin_radius", "pin_roundness")
"""Errors of the pins."""
SOLVED_AT_ONCE = 2_000
"""States that are solved together: 50 MB of forces."""
SAME_LENGTH = 1e-9
"""Arms and gaps [mm] and directions [-] that differ by less are the same."""


@dataclass(frozen=True)
class Units:
    """Errors of ``n`` units as the model takes them, the clearance of their bearings [mm], and their modulus."""

    errors: ModelErrors
    clearance: Real
    modulus: Real | None

    @classmethod
    def from_errors(cls, study: Study, sampled_errors: Errors) -> "Units":
        """Sampled units of a study."""
        clearance = assembly.bearing_clearance(study.design, sampled_errors.bearing_clearance)
        return cls(assembly.errors(sampled_errors), clearance, assembly.modulus(study.design, sampled_errors))

    def __len__(self) -> int:
        return len(self.clearance)

    def some(self, rows: Index | slice) -> "Units":
        """Some of the units."""
        errors = ModelErrors(**{name: values[rows] for name, values in vars(self.errors).items()})
        return Units(errors, self.clearance[rows], None if self.modulus is None else self.modulus[rows])


@dataclass(frozen=True)
class TurnDrives:
    """The drives of a study over a turn of the output.

    Attributes
    ----------
    phases : of each pitch.
    blocks : of each phase (n_lobes, n_contacts, n_contacts) [mm/N] compliance after 0, 1, ... pitches, the pins of each
        disk in the order of their places about its eccentric.
    laws : of each phase, in the same order.
    cycle : torques of the metrics.
    """

    study: Study
    phases: int
    blocks: tuple[Real, ...]
    laws: tuple[ContactLaws, ...]
    cycle: LoadCycle

    @classmethod
    def from_blocks(cls, study: Study, phases: int, blocks: Sequence[Real]) -> "TurnDrives":
        """From the condensed disks of each phase."""
        cranks = [360.0 * phase / (study.design.cycloid.pins * phases) for phase in range(phases)]
        laws = tuple(assembly.contact_laws(study, assembly.reducer(study.design, crank)) for crank in cranks)
        return cls(study, phases, tuple(blocks), laws, assembly.load_cycle(study, 0))

    @property
    def pitches(self) -> int:
        """Pitches of the pins in a turn of the output."""
        return self.study.design.cycloid.pins * self.study.design.cycloid.lobes

    def crank_deg(self, step: int | Index) -> float | Real:
        """Crank angle [degrees] of steps."""
        return 360.0 * step / (self.study.design.cycloid.pins * self.phases)

    def places(self, pitch: int) -> Index:
        """Place about the eccentric (n_contacts,) of each contact after so many pitches; outputs have their own."""
        return places(self.study, len(self.laws[0]), pitch)

    def drive(self, step: int, units: Units) -> Drive:
        """Units at a step."""
        study, (pitch, phase) = self.study, divmod(int(step), self.phases)
        order, block, kept = self.places(pitch), self.blocks[phase], self._kept_compliance
        crank, laws = float(self.crank_deg(int(step))), self.laws[phase][order]
        compliance = None if kept is not None else block[pitch % len(block)][np.ix_(order, order)]
        drive = drive_of(study, crank, compliance, units.errors, units.clearance, laws, units.modulus)
        return drive if kept is None else replace(drive, compliance=kept)

    @cached_property
    def _kept_compliance(self) -> Real | None:
        """Compliance (n_contacts, n_contacts) [mm/N] of rigid disks on cranks, with which it turns; None of others."""
        design, is_rigid = self.study.design, self.study.reduce.disk == "rigid"
        if not (is_rigid and design.output.carries_disks) or design.housing.ring or design.effects:
            return None
        compliance = assembly.compliance_beside_disks(design, assembly.reducer(design, 0.0))
        compliance.flags.writeable = False
        return compliance

    @cached_property
    def repeats(self) -> bool:
        """Whether the drive repeats, turned in the housing, after as many pitches as there are lobes.

        Cranks of a carrier turn by other ratios, and effects may depend on the angle of the crank.
        """
        study = self.study
        if study.design.effects or study.design.output.carries_disks:
            return False
        reducers = [assembly.reducer(study.design, float(self.crank_deg(step))) for step in (1, 1 + self._period)]
        parts = []
        for reducer, pitch in zip(reducers, (0, self._period // self.phases), strict=True):
            order = np.argsort(self.places(pitch))
            contacts = reducer.contacts
            direction = contacts.normal[order] * np.exp(-1j * reducer.crank)
            parts.append((contacts.arm[order], contacts.gap[order], contacts.per_eccentricity[order], direction))
        return not reducers[0].displacements and all(
            np.allclose(value_before, value_after, rtol=0, atol=SAME_LENGTH)
            for value_before, value_after in zip(*parts, strict=True)
        )

    @property
    def _period(self) -> int:
        """Steps of as many pitches as there are lobes."""
        return self.study.design.cycloid.lobes * self.phases

    def values_at(self, steps: Index, rows: Index, units: Units) -> "StepValues":
        """What is read of pairs (n_pairs,) of a step and a unit; those that one drive serves are solved together."""
        values = StepValues(np.empty((len(steps), len(library()))), np.empty((len(steps), len(TURN_ANGLES))))
        for part, step, turned in self._together(steps, rows, units):
            values.put(part, self.solve_step(step, turned)[2])
        return values

    def backlash_change_at(self, steps: Index, rows: Index, units: Units) -> Real:
        """What finite motions add to the rigid backlash (n_pairs,) [rad] of pairs (n_pairs,) of a step and a unit."""
        change = np.empty(len(steps))
        for part, step, turned in self._together(steps, rows, units):
            change[part] = self.drive(step, turned).backlash_change
        return change

    def _together(self, steps: Index, rows: Index, units: Units) -> Iterator[tuple[Index, int, Units]]:
        """Numbers of pairs (n_pairs,) that one drive serves, its step, and the units as they are there."""
        turns, first_steps = np.divmod(steps, self._period) if self.repeats else (np.zeros_like(steps), steps)
        order = np.argsort(first_steps, kind="stable")
        steps_found, start = np.unique(first_steps[order], return_index=True)
        for step, group in zip(steps_found, np.split(order, start)[1:], strict=True):
            for part in np.split(group, np.arange(SOLVED_AT_ONCE, len(group), SOLVED_AT_ONCE)):
                yield part, int(step), self._units_turned_back(units.some(rows[part]), turns[part])

    def _units_turned_back(self, units: Units, turns: Index) -> Units:
        """Units (n,) as they are after so many (n,) times as many pitches as there are lobes, turned back."""
        if not np.any(turns):
            return units
        pins, errors = self.study.design.cycloid.pins, units.errors
        place = (np.arange(pins) + turns[:, None]) % pins
        of_pins = {name: getattr(errors, name) for name in HOUSING_ERRORS}
        rolled_errors = {name: values[np.arange(len(turns))[:, None], place] for name, values in of_pins.items()}
        angle = np.multiply.outer(2 * np.pi / pins * self.study.design.cycloid.lobes * turns, np.array(ORDERS))
        rolled_errors["pin_roundness"] = rolled_errors["pin_roundness"] * np.exp(1j * angle)[:, None]
        return replace(units, errors=replace(errors, **rolled_errors))

    def solve_step(self, step: int, units: Units) -> tuple[Drive, CycleResponse, "StepValues"]:
        """Drive and response of units at a step, and what is read of them."""
        drive = self.drive(step, units)
        return drive, *solved_values(self.study, drive, self.cycle)


@dataclass(frozen=True)
class StepValues:
    """What is read of ``n`` units at steps; missing where it does not hold.

    Attributes
    ----------
    metrics : (n, n_metrics) every metric of a loop.
    angles : (n, n_angles) [arcmin] of the output, in the order of ``TURN_ANGLES``.
    """

    metrics: Real
    angles: Real

    def put(self, rows: Index, values: "StepValues") -> None:
        """Take the values of some rows."""
        self.metrics[rows], self.angles[rows] = values.metrics, values.angles


def solved_values(study: Study, drive: Drive, cycle: LoadCycle) -> tuple[CycleResponse, StepValues]:
    """Response of ``n`` units of a drive, and what is read of it."""
    response, definitions = respond(drive, cycle), assembly.definitions(study)
    force = np.max(response.equilibria.force, axis=1, keepdims=True)
    peak = np.max(drive.laws_of_states.peak_pressure(force), axis=(1, 2))
    readings = loop_readings(response, peak, definitions)
    if drive.reducer.n_disks > 1:
        readings.load_share[:] = torque_shares(drive, response, definitions).max(axis=(1, 2))
    invalid = invalid_metrics(drive, response, definitions)
    values = [
        np.where(response.converged & (invalid[name] == ""), metric.values(readings, definitions), np.nan)
        for name, metric in library().items()
    ]
    is_held = {
        name: response.converged & (invalid[metric] == "") for names, metric in READ_AT.items() for name in names
    }
    angles = [np.where(is_held[name], getattr(readings, name), np.nan) for name in TURN_ANGLES]
    return response, StepValues(np.stack(values, axis=1), np.stack(angles, axis=1))


def places(study: Study, n_contacts: int, pitch: int) -> Index:
    """Place about the eccentric (n_contacts,) of each contact of a reducer after so many pitches of the pins."""
    pins, disks = study.design.cycloid.pins, study.design.disk.count
    order = np.arange(n_contacts)
    for disk in range(disks):
        order[disk * pins : (disk + 1) * pins] = disk * pins + (np.arange(pins) + pitch) % pins
    return order


def full_blocks(study: Study, phase_deg: float, condense: Condense) -> Real:
    """Compliance (n_lobes, n_contacts, n_contacts) [mm/N] of any disks after 0, 1, ... pitches, by places.

    Parameters
    ----------
    phase_deg : crank angle of the phase.
    condense : the disks at a crank angle.

    Notes
    -----
    Seen from a disk its eccentric comes back to the same direction after as many pitches as it has lobes.
    """
    cycloid = study.design.cycloid
    blocks = []
    for pitch in range(cycloid.lobes):
        crank = phase_deg + 360.0 * pitch / cycloid.pins
        reducer = assembly.reducer(study.design, crank)
        full = assembly.joined_blocks(reducer, condense(crank))
        order = places(study, len(full), pitch)
        by_place = np.empty_like(full)
        by_place[np.ix_(order, order)] = full
        blocks.append(by_place)
    return np.array(blocks)


def turned_blocks(study: Study, disk: "ElasticBody", phase_deg: float) -> Real:
    """As `full_blocks`, of a single disk of equal sectors: condensed once, with the slide at every lobe."""
    from pipeline.elastic import disk_patches  # slow to import, and few runs mesh

    reducer = assembly.reducer(study.design, phase_deg)
    patches, rows = disk_patches(study, disk, reducer), assembly.disk_contacts(reducer)
    matrices = disk.turned_compliance(patches, np.arange(reducer.n_pins, len(patches)))
    full = np.zeros((len(matrices), len(reducer.contacts), len(reducer.contacts)))
    full[:, rows[:, None], rows] = matrices
    return full


def symmetric(study: Study) -> bool:
    """Whether the disk repeats from lobe to lobe: a single elastic one without holes."""
    reducer = assembly.reducer(study.design, 0.0)
    return reducer.n_disks == 1 and study.reduce.disk == "elastic" and not np.any(reducer.contacts.hole >= 0)
