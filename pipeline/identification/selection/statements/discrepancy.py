"""What a fitted model misses, as a Gaussian process over torque, sense of loading and position.

Part of the residual that is alike in neighbouring torques is no noise: it has a size, a reach and a place, and it makes
the parameters less certain than noise would, and may move them.

Source: Kennedy and O'Hagan, J. R. Stat. Soc. B 63 (2001) 425; sizes and reach by the restricted likelihood, Patterson
and Thompson, Biometrika 58 (1971) 545.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.optimize import minimize

from pipeline.arrays import Real, Truth, Whole
from pipeline.constant_kinds import Fineness, Grid, Rounding
from pipeline.identification.fitting.fitter import STEP, Fitter
from pipeline.identification.fitting.parameters import Fit, values_at_shares
from pipeline.statistics.curve_scatter import dummies

TORQUE_BINS: Fineness = 24
"""Intervals of the range of the torque, for each sense and position, over which cells are averaged."""
REACHES = (0.03, 1.0)
"""Reach of the process in largest torques: cells are as wide as the first, a shape as wide as the last."""
SIZES: Grid = (1e-3, 1e3)
"""Ends of the sizes of the process, in standard deviations of noise."""
JITTER: Rounding = 1e-9
"""Share of the noise's variance that keeps matrices definite."""


@dataclass(frozen=True)
class Discrepancy:
    """Structure in a residual, and the parameters beside it.

    Attributes
    ----------
    common_arcmin, own_arcmin : standard deviations of what all positions share, and of what each has by itself; of a
        single position both together, and NaN.
    reach_Nm : torque over which it is alike.
    structured : share of the mean square residual that is neither noise nor offset.
    worst_torque_Nm, worst_sense, worst_arcmin : where what all positions share is largest, and its size there.
    moved : (n_parameters,) change of the parameters when the process is allowed.
    error : (n_parameters,) standard errors of the parameters then.
    """

    common_arcmin: float
    own_arcmin: float
    reach_Nm: float
    structured: float
    worst_torque_Nm: float
    worst_sense: int
    worst_arcmin: float
    moved: Real
    error: Real

    @property
    def as_json(self) -> dict[str, Any]:
        """All of it as JSON takes it."""
        return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in vars(self).items()}


def discrepancy(
    torque: Real, sense: Real, position: Whole, residual: Real, sigma: Real, jacobian: Real, random: Real | None = None
) -> Discrepancy:
    """The discrepancy of a fitted model.

    Parameters
    ----------
    torque, sense, position : (n_cells,) [N m]; +1 or -1; number.
    residual, sigma : (n_cells,) [arcmin] measured less fitted, and its noise.
    jacobian : (n_cells, n_parameters) d angle / d parameters.
    random : (n_cells, n_random) [arcmin] d angle / d what is only known to have unit variance, such as tolerances.
    """
    n = jacobian.shape[1]
    random_columns = np.zeros((len(residual), 0)) if random is None else random
    states, means, noise, columns = averaged_cells(
        torque, sense, position, residual, sigma, np.hstack([jacobian, random_columns])
    )
    design = np.hstack([columns[:, :n], dummies(states[2])])
    base = columns[:, n:] @ columns[:, n:].T + np.diag(noise**2 * (1 + JITTER))
    top, unit = float(np.max(np.abs(torque))), float(np.median(noise))
    scale = np.maximum(np.linalg.norm(design, axis=0), 1e-300)
    design = design / scale

    def covariance(logs: Real) -> tuple[Real, Real]:
        shared_kernel, position_kernel = kernels(states, states, np.exp(logs[2]) * top)
        sizes = unit**2 * np.exp(2 * logs[:2])
        return sizes[0] * shared_kernel, sizes[1] * position_kernel

    def misfit(logs: Real) -> float:
        return -restricted_likelihood(sum(covariance(logs)) + base, design, means)

    most_likely = _most_likely(misfit)
    shared_part, position_kernel = covariance(most_likely)
    factor = cho_factor(shared_part + position_kernel + base)
    spread = np.linalg.pinv(design.T @ cho_solve(factor, design))
    amounts = spread @ (design.T @ cho_solve(factor, means))
    weights = cho_solve(factor, means - design @ amounts)
    common, predicted_means = shared_part @ weights, (shared_part + position_kernel) @ weights
    largest_row = int(np.argmax(np.abs(common)))
    centred_means = means - dummies(states[2]) @ np.linalg.lstsq(dummies(states[2]), means, rcond=None)[0]
    share_left = np.mean((means - design @ amounts - predicted_means) ** 2) / np.mean(centred_means**2)
    sizes = unit * np.exp(most_likely[:2])
    single_position = len(np.unique(states[2])) == 1
    return Discrepancy(
        common_arcmin=float(np.hypot(*sizes) if single_position else sizes[0]),
        own_arcmin=float("nan") if single_position else float(sizes[1]),
        reach_Nm=top * float(np.exp(most_likely[2])),
        structured=float(np.clip(1 - share_left, 0, 1)),
        worst_torque_Nm=float(states[0][largest_row]),
        worst_sense=int(states[1][largest_row]),
        worst_arcmin=float(common[largest_row]),
        moved=(amounts / scale)[:n],
        error=(np.sqrt(np.diag(spread)) / scale)[:n],
    )


def _most_likely(misfit: Callable[[Real], float]) -> Real:
    """Logarithms (3,) of both sizes and of the reach, in their units, at which ``misfit`` is least."""
    bounds = [tuple(np.log(SIZES)), tuple(np.log(SIZES)), tuple(np.log(REACHES))]
    starts = [np.log([size, size, reach]) for size in (0.3, 10.0) for reach in (0.1, 0.4)]
    fits = [minimize(misfit, start, bounds=bounds, method="L-BFGS-B") for start in starts]
    most_likely: Real = min(fits, key=lambda fit: fit.fun).x
    return most_likely


def discrepancy_of(fitter: Fitter, fit: Fit, direction: Whole, cells: Truth) -> Discrepancy:
    """The discrepancy of a fit over cells (n_cells,), its parameters those of the effects, in their units.

    Parameters
    ----------
    direction : (n_cells,) +1 where the torque rises, -1 where it falls.

    Notes
    -----
    Calibrated numbers and tolerances vary about what is declared as their priors say.
    """
    data, unknowns = fitter.problem.data, fit.unknowns
    first_share, last_share = len(unknowns.scales), len(unknowns.scales) + len(unknowns.shares)
    spread = np.concatenate([fitter.problem.scale_spread, np.ones(len(unknowns.modes))])
    random = np.hstack([fit.jacobian[:, :first_share], fit.jacobian[:, last_share:]]) * spread
    residual = data.angle - fit.predicted_angle + random @ (np.concatenate([unknowns.scales, unknowns.modes]) / spread)
    bounds = fitter.bounds(fit.model)
    perturbed_values = [values_at_shares(bounds, unknowns.shares + step) for step in (-STEP, STEP)]
    shares_by_value = 2 * STEP / (perturbed_values[1] - perturbed_values[0])
    jacobian = fit.jacobian[:, first_share:last_share] * shares_by_value
    return discrepancy(
        data.torque[cells],
        direction[cells].astype(float),
        data.position[cells],
        residual[cells],
        data.sigma[cells],
        jacobian[cells],
        random[cells],
    )


def restricted_likelihood(covariance: Real, design: Real, values: Real) -> float:
    """Logarithm of the likelihood of what of the values (n,) the columns of the design (n, k) do not explain.

    But for a constant; -inf where the covariance (n, n) is not definite.
    """
    try:
        factor = cho_factor(covariance, lower=True)
    except LinAlgError:
        return -np.inf
    whitened_design = cho_solve(factor, design)
    information = design.T @ whitened_design + 1e-12 * np.eye(design.shape[1])
    amounts = np.linalg.solve(information, whitened_design.T @ values)
    residual = values - design @ amounts
    _, size = np.linalg.slogdet(information)
    return float(-0.5 * (2 * np.sum(np.log(np.diag(factor[0]))) + size + residual @ cho_solve(factor, residual)))


def averaged_cells(
    torque: Real, sense: Real, position: Whole, residual: Real, sigma: Real, jacobian: Real
) -> tuple[tuple[Real, Real, Whole], Real, Real, Real]:
    """Cells of one position, sense and interval of torque as one: place, residual, noise, columns.

    A place is torque, sense and number of the position, each (n_places,), the numbers in the order of the positions.
    """
    _, number = np.unique(position, return_inverse=True)
    edges = np.linspace(torque.min(), torque.max(), TORQUE_BINS + 1)
    interval = np.clip(np.searchsorted(edges, torque, side="right") - 1, 0, TORQUE_BINS - 1)
    _, kind = np.unique((2 * number + (sense > 0)) * TORQUE_BINS + interval, return_inverse=True)
    weight = 1 / sigma**2
    total = np.bincount(kind, weight)

    def mean(values: Real) -> Real:
        return np.bincount(kind, weight * values) / total

    mean_state = mean(torque), np.sign(mean(sense)), np.rint(mean(number.astype(float))).astype(np.int64)
    columns = np.column_stack([mean(column) for column in jacobian.T]) if jacobian.size else np.zeros((len(total), 0))
    return mean_state, mean(residual), 1 / np.sqrt(total), columns


def kernels(places: tuple[Real, Real, Whole], cells: tuple[Real, Real, Whole], reach: float) -> tuple[Real, Real]:
    """Correlation (n_places, n_others) of what all positions share, and of what each has by itself."""
    torque, sense, position = (np.asarray(part)[:, None] for part in places)
    correlation = np.exp(-0.5 * ((torque - cells[0]) / reach) ** 2) * (sense == cells[1])
    return correlation, correlation * (position == cells[2])
