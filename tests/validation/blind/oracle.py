"""What could be told apart at all.

Effects are fitted with the generator's own model, all else known, to curves without noise.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.arrays import Real
from pipeline.config.studies.study import Study
from pipeline.config.studies.tolerances import Case
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import Fit, shares_of_values
from pipeline.identification.fitting.problem import Candidate, Model, candidates, limit_cases
from pipeline.identification.measurement.unit_file import load_measured_unit
from tests.validation.blind.effect_size import problem_of
from tests.validation.blind.files import DIMENSIONS
from tests.validation.blind.generate import OUTSIDE_KIND, Made

NEAREST = 3
"""Effects that are fitted in full, the best of a linearised look."""
ITERATIONS = 6
"""Least-squares steps of a fit that starts at the truth."""
STEPS = (1e-4, 1e-2)
"""Amplitudes of the secants, as shares of the bounds."""
SHAPES = (0.15, 0.4, 0.65)
"""Shares of the bounds at which parameters without a zero are looked at."""


def distances(unit_made: Made, folder: Path, root: Path) -> dict[str, float]:
    """Rms distance [noise floors] from the true curves of the nearest effects that are not the true one, by name.

    Parameters
    ----------
    unit_made : a unit with one effect of the library, or one outside it.
    folder : of its files: their rows are the places that are compared.

    Notes
    -----
    Calibrated numbers are refitted beside each effect. An effect that becomes the true one at a limit of its
    parameters is left out: the simpler of the two is named anyway.
    """
    unit = load_measured_unit(folder, root)
    true_errors: dict[str, Any] = {
        name: tuple(value.tolist()) if np.ndim(value := getattr(unit_made.dimensions, name)[0]) else float(value)
        for name in DIMENSIONS
    }
    true_unit = replace(unit, design_study=unit_made.unit.study, dimensions=Case(label="true", **true_errors))
    nominal = unit_made.reducer.truth.design.disk.thickness_mm / unit_made.unit.study.design.disk.thickness_mm

    def softened(study: Study, cranks: Sequence[float]) -> list[Real]:
        return [nominal * matrix for matrix in unit_made.compliances(study, cranks)]

    problem, over_cells = problem_of(true_unit, softened)
    true = unit_made.truth["truth"]
    fitter = Fitter(problem)
    if unit_made.truth["kind"] == OUTSIDE_KIND:
        curves = over_cells(np.concatenate(unit_made.angles))
    else:
        testable, (facts,) = problem.candidates_for(candidates(), problem.training), unit_made.truth["effects"]
        model = Model((testable[true],))
        shares = shares_of_values(fitter.bounds(model), [*facts["values"], *facts["values_of_positions"]])
        curves = fitter.predict(model, fitter.start(model, shares)).angle
    problem = replace(problem, data=replace(problem.data, angle=curves))
    fitter, all_cells = Fitter(problem), np.ones(len(problem.data), bool)
    base = fitter.fit(Model(), all_cells, fitter.start(Model()))
    misfits = {
        name: _look(fitter, base, candidate)
        for name, candidate in candidates().items()
        if not problem.why_not(candidate) and name != true and limit_cases().get(name) != true
    }
    distance_by_name = {}
    for name in sorted(misfits, key=lambda name: misfits[name][0])[:NEAREST]:
        start = replace(base.unknowns, shares=misfits[name][1])
        fit = fitter.fit(Model((candidates()[name],)), all_cells, start, ITERATIONS)
        if np.isfinite(fit.cost):
            misfit = (curves - fit.predicted_angle) / problem.data.sigma
            distance_by_name[name] = float(np.sqrt(np.mean(misfit**2)))
    return distance_by_name


def _look(fitter: Fitter, base: Fit, candidate: Candidate) -> tuple[float, Real]:
    """Least misfit of an effect by linear least squares from small secants, and the shares of its bounds there."""
    problem, model = fitter.problem, Model((candidate,))
    data, bounds = problem.data, np.array(problem.bounds(candidate))
    grows = (bounds[:, 0] <= 0) & (bounds[:, 1] >= 0)
    weight = 1 / data.sigma**2
    residual = fitter.centred_values(data.angle - base.predicted_angle, weight) / data.sigma
    rows = np.vstack([base.jacobian / data.sigma[:, None], np.diag(fitter.penalty(base.unknowns))])
    basis = np.linalg.qr(rows)[0] if rows.shape[1] else rows

    def free(values: Real) -> Real:
        padded: Real = np.concatenate([values, np.zeros((len(basis) - len(values), *values.shape[1:]))])
        return padded - basis @ (basis.T @ padded)

    def secant(shares: Real) -> Real:
        angle = fitter.predict(model, replace(base.unknowns, shares=shares)).angle
        return free(fitter.centred_values(np.nan_to_num(angle - base_angle), weight) / data.sigma)

    base_angle = fitter.predict(Model(), base.unknowns).angle
    zero = np.where(grows, -bounds[:, 0] / np.ptp(bounds, axis=1), 0.0)
    goal, best = free(residual), (np.inf, zero)
    for shape, step in product(SHAPES if not np.all(grows) else SHAPES[:1], STEPS):
        trial_shape = np.where(grows, zero, shape)
        columns = np.column_stack([secant(trial_shape + step * direction) for direction in np.eye(len(bounds))[grows]])
        amounts = np.linalg.lstsq(columns, goal, rcond=None)[0]
        shares = trial_shape.copy()
        shares[grows] = np.clip(zero[grows] + step * amounts, 0, 1)
        misfit = float(np.sum((goal - secant(shares)) ** 2))
        if misfit < best[0]:
            best = misfit, shares
    return best
