"""The reducer under test, and what a check of it finds beside a reference, with the error and its limit.

A specimen is one sample of a study at crank 0, with its meshed disk condensed once for all checks.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipeline import assembly, elastic
from pipeline.arrays import Real
from pipeline.config import Study
from pipeline.config.studies.study import Reduce
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.elastic.condensed_body import Compliance, ElasticBody
from pipeline.model.elastic.pressure_patches import Patches
from pipeline.model.equilibrium.solve import ElasticReducer, Equilibria, solve
from pipeline.model.geometry.clearance import gaps
from pipeline.model.geometry.cycloid_profile import CycloidProfile
from pipeline.model.geometry.reducer import Bearing, Reducer
from pipeline.model.geometry.rigid_play.rigid_backlash import rigid_play
from pipeline.model.units import NMM_PER_NM
from pipeline.sampling.errors import draw

SHARES = np.array([0.03, 0.25, 0.5, 0.75, 1.0])
"""Of the rated torque: the loads of the checks."""


@dataclass(frozen=True)
class Specimen:
    """One sample of a study at one crank angle.

    Attributes
    ----------
    study : its design, mesh and tolerances.
    sample : number of the sample.
    crank_deg : crank angle [degrees].
    """

    study: Study
    sample: int = 1
    crank_deg: float = 0.0

    @cached_property
    def profile(self) -> CycloidProfile:
        return assembly.profile(self.study.design)

    @cached_property
    def reducer(self) -> Reducer:
        return assembly.reducer(self.study.design, self.crank_deg)

    @cached_property
    def bearing(self) -> Bearing:
        return assembly.bearing(self.study.design)

    @cached_property
    def laws(self) -> ContactLaws:
        return assembly.contact_laws(self.study, self.reducer)

    @cached_property
    def gap(self) -> Real:
        """Gap of every contact (n_contacts,) [mm]."""
        errors = assembly.errors(draw(self.study, self.sample, self.sample + 1))
        gap: Real = gaps(self.profile, self.reducer, errors, **dict(self.study.clearance))[0]
        return gap

    @cached_property
    def bearing_clearance(self) -> float:
        """Radial clearance of the input bearing [mm]."""
        sampled_errors = draw(self.study, self.sample, self.sample + 1)
        return float(assembly.bearing_clearance(self.study.design, sampled_errors.bearing_clearance)[0])

    @cached_property
    def disk(self) -> ElasticBody:
        return elastic.elastic_disk(self.study)

    @cached_property
    def disk_rows(self) -> np.ndarray:
        """Contacts that load the disk, in the order of its patches."""
        return assembly.disk_contacts(self.reducer)

    @cached_property
    def patches(self) -> Patches:
        return elastic.disk_patches(self.study, self.disk, self.reducer)

    @cached_property
    def disk_compliance(self) -> Compliance:
        return self.disk.compliance(self.patches)

    @cached_property
    def compliance(self) -> Real:
        """Compliance between all contacts (n_contacts, n_contacts) [mm/N], zero between rigid bodies."""
        return assembly.joined_blocks(self.reducer, [self.disk_compliance.matrix])

    @property
    def rated_torque(self) -> float:
        """[N mm]"""
        return NMM_PER_NM * self.study.design.cycloid.rated_torque_Nm

    def in_stress(self, stress: str) -> "Specimen":
        """The same sample with the disk in ``plane_stress`` or ``plane_strain``."""
        design = self.study.design.with_section("disk", stress=stress)
        return Specimen(self.study.model_copy(update={"design": design}), self.sample, self.crank_deg)

    def meshed_as(self, reduce: Reduce) -> "Specimen":
        """The same sample on another mesh; itself on its own."""
        if reduce == self.study.reduce:
            return self
        return Specimen(self.study.model_copy(update={"reduce": reduce}), self.sample, self.crank_deg)


def loaded_equilibria(
    specimen: Specimen,
    torque: Real,
    compliance: Real | None = None,
    gap: Real | None = None,
    reducer: Reducer | None = None,
) -> Equilibria:
    """Equilibria of the sample at the output torques [N mm] of one sense, from the end of its free play.

    ``compliance``, ``gap`` and ``reducer`` take the place of the sample's own.
    """
    loaded_reducer = reducer or specimen.reducer
    gaps_of_one = (specimen.gap if gap is None else gap)[None]
    clearance = np.array([specimen.bearing_clearance])
    play = rigid_play(loaded_reducer, gaps_of_one, clearance)
    start = play.pose_plus if torque[0] > 0 else play.pose_minus
    matrix = specimen.compliance if compliance is None else compliance
    on_springs = ElasticReducer(loaded_reducer, specimen.bearing, specimen.laws, matrix)
    return solve(on_springs, gaps_of_one, clearance, start, torque)


@dataclass(frozen=True)
class Finding:
    """One number of a check.

    Attributes
    ----------
    quantity : what is compared, with its unit.
    reference, computed_value : the two numbers [of the quantity's unit]; of arrays, the entries that differ most.
    error : their difference, absolute or relative as the quantity says.
    limit : largest error allowed; None for a number that is only stated.
    is_skipped : whether the check could not be made on this machine.
    """

    quantity: str
    reference: float
    computed_value: float
    error: float
    limit: float | None
    is_skipped: bool = False

    @property
    def ok(self) -> bool | None:
        """Whether the error keeps the limit; None if the check was skipped. NaN keeps no limit."""
        if self.is_skipped:
            return None
        return self.limit is None or bool(self.error <= self.limit)


Check = Callable[[Specimen], Iterator[Finding]]


def largest_difference(
    quantity: str, reference: ArrayLike, computed_values: ArrayLike, limit: float, scale: Any = 1.0
) -> Finding:
    """The entries that differ most; the error is their difference over ``scale`` (a number or one per entry)."""
    reference, computed_values, scale = np.broadcast_arrays(np.asarray(reference, float), computed_values, scale)
    error = np.abs(computed_values - reference) / np.abs(scale)
    worst_entry = int(np.argmax(np.where(np.isnan(error), np.inf, error)))
    reference_there, computed_there, error_there = (
        float(values.flat[worst_entry]) for values in (reference, computed_values, error)
    )
    return Finding(quantity, reference_there, computed_there, error_there, limit)


def relative(quantity: str, reference: ArrayLike, computed_values: ArrayLike, limit: float) -> Finding:
    """The entries that differ most in proportion to the reference."""
    return largest_difference(quantity, reference, computed_values, limit, scale=reference)


def vanishing(quantity: str, computed_values: ArrayLike, limit: float) -> Finding:
    """The largest magnitude of what must be zero."""
    return largest_difference(quantity, 0.0, computed_values, limit)


def at_least(quantity: str, bound: float, computed_values: ArrayLike) -> Finding:
    """The smallest value of what must not fall below ``bound``; the error is what it lacks."""
    smallest_value = float(np.min(computed_values))
    return Finding(quantity, bound, smallest_value, max(0.0, bound - smallest_value), 0.0)


def positive(quantity: str, computed_values: ArrayLike) -> Finding:
    """The smallest value of what must be positive."""
    return at_least(quantity, float(np.finfo(float).tiny), computed_values)


def reported_number(quantity: str, value: float, reference: float = np.nan) -> Finding:
    """A number that is reported and judged by nothing."""
    return Finding(quantity, reference, value, np.nan, None)


def skipped_check(quantity: str) -> Finding:
    """A check that this machine cannot make; ``quantity`` says what it lacks."""
    return Finding(quantity, np.nan, np.nan, np.nan, None, is_skipped=True)
