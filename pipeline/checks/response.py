"""The metrics of a study's cases as a function of the design's numbers, fast enough to fit them.

The disk is condensed once; its compliance goes with 1/(thickness x modulus), so those need no new mesh. A change of
patches or mesh needs another `condense_disk`. Effects that the design names are in the springs, the gaps and the
torsion; with friction the clearance backlash is still the frictionless one.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline import assembly, elastic
from pipeline.arrays import Real
from pipeline.config.designs.design import Design
from pipeline.config.files.section import with_value
from pipeline.config.studies.study import Study
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.load_history.load_cycle import ARCMIN, BRANCHES, LoadCycle
from pipeline.model.load_history.loop_readings import loop_readings
from pipeline.model.load_history.response import CycleResponse, respond
from pipeline.model.metrics import library
from pipeline.mounting import drive_of
from pipeline.sampling.errors import draw

METRICS = ("clearance_backlash_arcmin", "lost_motion_arcmin", "torsional_rigidity_Nm_per_arcmin")
LEVELS = 5
"""Equal load steps besides those that the metrics ask for: a state depends on its torque alone, more change nothing."""


@dataclass(frozen=True)
class Condensed:
    """Compliance of a disk of unit thickness and unit modulus between all contacts.

    Attributes
    ----------
    matrix : (n_contacts, n_contacts) [1], compliance x thickness x E.
    """

    matrix: Real

    @classmethod
    def from_compliance(cls, compliance: Real, design: Design) -> "Condensed":
        """From the compliance (n_contacts, n_contacts) [mm/N] of the design's disk."""
        return cls(compliance * design.disk.thickness_mm * _modulus(design))

    def compliance(self, design: Design) -> Real:
        """Compliance (n_contacts, n_contacts) [mm/N] of the design's disk."""
        return self.matrix / (design.disk.thickness_mm * _modulus(design))


@dataclass(frozen=True)
class SolvedCases:
    """The study's cases at its first crank angle: ``gap`` (n, n_contacts) [mm] and the response to the load cycle."""

    reducer: Reducer
    laws: ContactLaws
    gap: Real
    cycle: LoadCycle
    response: CycleResponse

    def step(self, branch: str, percent: float) -> int:
        """Step of a branch at ``percent`` of the rated torque, the nearest that it has."""
        of_branch = np.flatnonzero(self.response.branch == BRANCHES.index(branch))
        torque = percent / 100 * self.cycle.rated_torque
        return int(of_branch[np.argmin(np.abs(self.response.torque[of_branch] - torque))])

    def force(self, percent: float) -> Real:
        """Contact forces (n, n_contacts) [N] on loading to ``percent`` of the rated torque; below 0 the other way."""
        step = self.step("loading+" if percent > 0 else "loading-", percent)
        return self.response.equilibria.force[:, self.response.state[step]]


def condense_disk(study: Study) -> Condensed:
    """The study's disk at its first crank angle, meshed and condensed."""
    reducer = assembly.reducer(study.design, study.cycle.crank_deg[0])
    disk = elastic.elastic_disk(study)
    rows = assembly.disk_contacts(reducer)
    matrix = np.zeros((len(reducer.contacts), len(reducer.contacts)))
    matrix[np.ix_(rows, rows)] = disk.compliance(elastic.disk_patches(study, disk, reducer)).matrix
    return Condensed.from_compliance(matrix, study.design)


def _modulus(design: Design) -> float:
    return design.materials[design.disk.material].youngs_modulus_MPa


def with_numbers(study: Study, values: Mapping[str, float]) -> Study:
    """The study with the design's numbers of these dotted keys replaced, not validated."""
    design: Any = study.design
    for key, value in values.items():
        design = with_value(design, key, value)
    return study.model_copy(update={"design": design})


def solve_cases(study: Study, disk: Condensed, backlash_percent: float = 0.0) -> SolvedCases:
    """All cases of the study through their load cycle.

    Parameters
    ----------
    backlash_percent : of the rated torque, a torque besides those of the metrics; 0 is none.

    Raises
    ------
    ArithmeticError
        If a load step has no solution.
    """
    design, metrics = study.design, study.metrics
    sampled_errors = draw(study, 0, study.samples.rows)
    clearance = assembly.bearing_clearance(design, sampled_errors.bearing_clearance)
    drive = drive_of(
        study, study.cycle.crank_deg[0], disk.compliance(design), assembly.errors(sampled_errors), clearance
    )
    percents = metrics.lost_motion_percent, *metrics.rigidity_percent, *([backlash_percent] if backlash_percent else [])
    marks = tuple(percent / 100 for percent in percents)
    cycle = LoadCycle.evenly(drive.rated_torque, LEVELS, study.cycle.torque_fraction, marks)
    response = respond(drive, cycle)
    if not np.all(response.converged):
        raise ArithmeticError(f"no equilibrium: residual {np.max(response.equilibria.residual):.1e}")
    return SolvedCases(drive.reducer, drive.laws, drive.gap, cycle, response)


def metrics_of(study: Study, cases: SolvedCases, backlash_percent: float = 0.0) -> Real:
    """The ``METRICS`` of every case (n, 3).

    Parameters
    ----------
    backlash_percent : of the rated torque, where the backlash is read on the way up in both senses; at 0 it is the
        limit of no torque.
    """
    definitions = assembly.definitions(study)
    readings = loop_readings(cases.response, np.full(len(cases.gap), np.nan), definitions)
    values = np.stack([library()[name].value(readings, definitions) for name in METRICS], axis=1)
    if backlash_percent:
        plus, minus = cases.step("loading+", backlash_percent), cases.step("loading-", -backlash_percent)
        values[:, 0] = ARCMIN * (cases.response.angle[:, plus] - cases.response.angle[:, minus])
    return values


def pins_in_contact(study: Study, cases: SolvedCases) -> np.ndarray:
    """Pins that carry force at the lost-motion torque (n,)."""
    force = cases.force(study.metrics.lost_motion_percent)
    return np.count_nonzero(force[:, : cases.reducer.n_pins] > 0, axis=1)
