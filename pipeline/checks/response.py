"""The metrics of a study's cases as a function of the design's numbers, fast enough to fit them.

The disk is condensed once; its compliance goes with 1/(thickness x modulus), so those need no new mesh. A change of
patches or mesh needs another `condense_disk`. Effects that the design names are in the springs, the gaps and the
torsion; with friction the clearance backlash is still the frictionless one.

`fit_numbers` finds positive numbers within bounds by least squares, with intervals by profile likelihood.
Numbers are fitted as logarithms: a stiffness known within a factor is as good as a length known within the same one.
The scatter of the data is not known beforehand, so it is estimated from the misfit itself: an interval holds the
values of a number at which the others can keep the sum of squares below (1 + F(1, freedom)/freedom) times its least.

Source: Seber and Wild, Nonlinear Regression (1989), 5.2.1 (asymptotic) and 5.4 (profile: likelihood ratio).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq, least_squares
from scipy.stats import f as f_distribution

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
    matrix = disk.compliance(elastic.disk_patches(study, disk, reducer)).matrix
    return Condensed.from_compliance(assembly.joined_blocks(reducer, [matrix]), study.design)


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
    force: Real = cases.force(study.metrics.lost_motion_percent)
    contacts: np.ndarray = np.count_nonzero(force[:, : cases.reducer.n_pins] > 0, axis=1)
    return contacts


STEP = 1e-4
"""Of the forward differences, in logarithms: far above the solver's 1e-9, far below the numbers' intervals."""
TOLERANCE = 1e-9
"""Relative change of numbers, misfit and slope at which a fit ends."""
END_TOLERANCE = 1e-6
"""To which the ends of an interval are found, in logarithms."""
SMALLEST_SINGULAR = 1e-10
"""Singular value, relative to the largest, that stands for none: the numbers' combination changes nothing."""
HIGHEST_CORRELATION = 0.95
"""Correlation from which two numbers are reported as not separable."""

Residual = Callable[[Real], Real]


@dataclass(frozen=True)
class Fitted:
    """Numbers of least squares.

    Attributes
    ----------
    value, low, high : (k,) the numbers and their intervals; NaN: the data do not bound the number on that side.
    residual : (n,) relative misfits.
    correlation : (k, k) of the numbers' logarithms.
    singular_values : (k,) of the misfits' derivatives by the logarithms, largest first.
    """

    value: Real
    low: Real
    high: Real
    residual: Real
    correlation: Real
    singular_values: Real

    @property
    def freedom(self) -> int:
        """Degrees of freedom: data less numbers."""
        return len(self.residual) - len(self.value)

    def warnings(self, names: tuple[str, ...]) -> list[str]:
        """What the data do not determine, one sentence each."""
        texts = []
        if self.freedom <= 0:
            texts.append(f"no intervals: {len(self.residual)} targets for {len(names)} numbers; they take more targets")
        for name, low, high in zip(names, self.low, self.high, strict=True) if self.freedom > 0 else ():
            open_ends = [side for side, end in (("below", low), ("above", high)) if np.isnan(end)]
            if open_ends:
                texts.append(f"{name} is not determined: nothing in the data bounds it {' or '.join(open_ends)}")
        for i, j in zip(*np.triu_indices(len(names), 1), strict=True):
            if abs(self.correlation[i, j]) > HIGHEST_CORRELATION:
                texts.append(f"{names[i]} and {names[j]} are not separable: correlation {self.correlation[i, j]:+.3f}")
        return texts


def fit_numbers(residual: Residual, start: Real, lower: Real, upper: Real, confidence: float | None) -> Fitted:
    """Fit ``start`` (k,) within its bounds; ``residual`` maps numbers (k,) to misfits (n,).

    ``confidence`` None leaves the intervals out: NaN.
    """
    logs, low, high = np.log(start), np.log(lower), np.log(upper)
    optimum, misfit, slope = _solve(residual, logs, low, high)
    _, singular, rotation = np.linalg.svd(slope, full_matrices=False)
    spread = rotation.T / np.maximum(singular, SMALLEST_SINGULAR * singular[0])
    covariance = spread @ spread.T
    scale = np.sqrt(np.diag(covariance))
    ends = np.full((2, len(start)), np.nan)
    freedom = len(misfit) - len(start)
    if confidence is not None and freedom > 0:
        limit = np.sum(misfit**2) * (1 + f_distribution.ppf(confidence, 1, freedom) / freedom)
        for k in range(len(start)):
            for side, bound in enumerate((low[k], high[k])):
                ends[side, k] = _end(residual, optimum, low, high, k, bound, limit)
    return Fitted(
        np.exp(optimum), np.exp(ends[0]), np.exp(ends[1]), misfit, covariance / np.outer(scale, scale), singular
    )


def _solve(residual: Residual, start: Real, low: Real, high: Real) -> tuple[Real, Real, Real]:
    """Logarithms, misfits and their derivatives at the least sum of squares."""

    def misfit(logs: Real) -> Real:
        return residual(np.exp(logs))

    def slope(logs: Real) -> Real:
        base = misfit(logs)
        columns = []
        for k in range(len(logs)):
            step = np.zeros(len(logs))
            step[k] = STEP if logs[k] + STEP <= high[k] else -STEP
            columns.append((misfit(logs + step) - base) / step[k])
        return np.stack(columns, axis=1)

    interior_start = np.clip(start, low + STEP, high - STEP)
    solution = least_squares(misfit, interior_start, slope, (low, high), xtol=TOLERANCE, ftol=TOLERANCE, gtol=TOLERANCE)
    return solution.x, solution.fun, solution.jac


def _end(residual: Residual, optimum: Real, low: Real, high: Real, k: int, bound: float, limit: float) -> float:
    """Where the profile of the number k reaches ``limit`` between the best value and the bound; NaN if nowhere."""
    is_free = np.arange(len(optimum)) != k

    def excess(log: float) -> float:
        def profile_residual(values: Real) -> Real:
            parameters = np.exp(optimum)
            parameters[k], parameters[is_free] = np.exp(log), values
            return residual(parameters)

        if not np.any(is_free):
            return float(np.sum(profile_residual(np.empty(0)) ** 2)) - limit
        return float(np.sum(_solve(profile_residual, optimum[is_free], low[is_free], high[is_free])[1] ** 2)) - limit

    if abs(bound - optimum[k]) < END_TOLERANCE or excess(bound) <= 0:
        return np.nan
    return float(brentq(excess, optimum[k], bound, xtol=END_TOLERANCE))
