"""The metrics of a study's cases as a function of the design's numbers, fast enough to fit them.

The disk is condensed once; its compliance goes with 1/(thickness x modulus), so those need no new mesh. What moves
patches or changes the mesh asks for another `condensed`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import BaseModel

from pipeline import assembly, elastic
from pipeline.config.design import Design
from pipeline.config.study import Study
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.equilibrium.solve import Equilibria
from pipeline.model.geometry.clearance import gaps
from pipeline.model.geometry.cycloid_profile import Real
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.load_history.load_cycle import ARCMIN, BRANCHES, LoadCycle, curve_metrics, solve_cycle
from pipeline.sampling import draw

METRICS = ("clearance_backlash_arcmin", "lost_motion_arcmin", "torsional_rigidity_Nm_per_arcmin")
NM_PER_NMM = 1e-3
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
    def of(cls, compliance: Real, design: Design) -> "Condensed":
        """From the compliance (n_contacts, n_contacts) [mm/N] of the design's disk."""
        return cls(compliance * design.disk.thickness_mm * _modulus(design))

    def compliance(self, design: Design) -> Real:
        """Compliance (n_contacts, n_contacts) [mm/N] of the design's disk."""
        return self.matrix / (design.disk.thickness_mm * _modulus(design))


@dataclass(frozen=True)
class Solved:
    """The study's cases at its first crank angle: ``gap`` (n, n_contacts) [mm] and the states of the cycle."""

    reducer: Reducer
    laws: ContactLaws
    gap: Real
    cycle: LoadCycle
    states: Equilibria


def condensed(study: Study) -> Condensed:
    """The study's disk at its first crank angle, meshed and condensed."""
    at = assembly.reducer(study.design, study.cycle.crank_deg[0])
    disk = elastic.elastic_disk(study)
    rows = assembly.disk_contacts(at)
    matrix = np.zeros((len(at.contacts), len(at.contacts)))
    matrix[np.ix_(rows, rows)] = disk.compliance(elastic.disk_patches(study, disk, at)).matrix
    return Condensed.of(matrix, study.design)


def _modulus(design: Design) -> float:
    return design.materials[design.disk.material].youngs_modulus_MPa


def with_numbers(study: Study, values: Mapping[str, float]) -> Study:
    """The study with the design's numbers of these dotted keys replaced, not validated."""
    design: Any = study.design
    for key, value in values.items():
        design = _replaced(design, key.split("."), value)
    return study.model_copy(update={"design": design})


def _replaced(section: Any, path: list[str], value: float) -> Any:
    name, *rest = path
    if isinstance(section, BaseModel):
        return section.model_copy(update={name: _replaced(getattr(section, name), rest, value) if rest else value})
    return {**section, name: _replaced(section[name], rest, value)}


def solved(study: Study, disk: Condensed) -> Solved:
    """All cases of the study through their load cycle.

    Raises
    ------
    ArithmeticError
        If a load step has no solution.
    """
    design, metrics = study.design, study.metrics
    at = assembly.reducer(design, study.cycle.crank_deg[0])
    sampled = draw(study, 0, study.samples.rows)
    gap = gaps(assembly.profile(design), at, assembly.errors(sampled), **dict(study.clearance))
    marks = tuple(percent / 100 for percent in (metrics.lost_motion_percent, *metrics.rigidity_percent))
    cycle = LoadCycle.evenly(
        assembly.NMM_PER_NM * design.cycloid.rated_torque_Nm, LEVELS, study.cycle.torque_fraction, marks
    )
    laws = assembly.contact_laws(study, at)
    loose = assembly.bearing_clearance(design, sampled.bearing_clearance)
    states = solve_cycle(at, assembly.bearing(design), laws, disk.compliance(design), gap, loose, cycle)
    if not np.all(states.converged):
        raise ArithmeticError(f"no equilibrium: residual {np.max(states.residual):.1e}")
    return Solved(at, laws, gap, cycle, states)


def metrics_of(study: Study, cases: Solved) -> Real:
    """The ``METRICS`` of every case (n, 3)."""
    branch, state = cases.cycle.steps
    numbers = curve_metrics(
        np.array(BRANCHES)[branch],
        NM_PER_NMM * cases.cycle.state_torque[state],
        ARCMIN * cases.states.motion[:, state, cases.reducer.output_motion],
        study.design.cycloid.rated_torque_Nm,
        study.metrics.lost_motion_percent / 100,
        (study.metrics.rigidity_percent[0] / 100, study.metrics.rigidity_percent[1] / 100),
    )
    return np.stack([numbers.zero_torque_width, numbers.lost_motion, numbers.torsional_rigidity], axis=1)


def pins_in_contact(study: Study, cases: Solved) -> np.ndarray:
    """Pins that carry force at the lost-motion torque (n,)."""
    wanted = cases.cycle.rated_torque * study.metrics.lost_motion_percent / 100
    state = int(np.argmin(np.abs(cases.cycle.state_torque - wanted)))
    return np.count_nonzero(cases.states.force[:, state, : cases.reducer.n_pins] > 0, axis=1)
