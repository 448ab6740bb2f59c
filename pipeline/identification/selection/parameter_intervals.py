"""Fitted parameters of effects with their intervals, and why some of them support no claim."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv, ndtri, stdtrit  # quantiles: scipy.stats is slow to import

from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import Fit, mapped, unmapped
from pipeline.statistics.blocks import resampled_means

Real = NDArray[np.float64]
Truth = NDArray[np.bool_]

FORM = 0.05
"""Share of what an effect explains that the form of the model (contact law, mesh, cells) may leave. Calibrated: the
parameters of blind units came out 1 to 6 % off."""
STRUCTURE = 1.25
"""Rms in floors up to which nothing structured is left above the noise."""
RESAMPLES = 400
"""Of the block bootstrap: an end of an interval is known to a tenth of its width."""
CONFIDENCE = 0.95
"""Of the intervals of fitted parameters."""
SEED = 79
"""Of the bootstrap: equal data give equal intervals."""
LARGEST_LOG = 10.0
"""Logarithm up to which an interval is widened: beyond it every bound of the library is reached."""
AT_BOUND = 0.01
"""Share of its bounds from an end at which a parameter stands there."""


@dataclass(frozen=True)
class FittedParameter:
    """A parameter of a named effect with its interval; NaN limits where the data give none, and why."""

    effect: str
    name: str
    unit: str
    value: float
    ci_low: float
    ci_high: float
    note: str = ""


def intervals(fitter: Fitter, fit: Fit, cells: Truth, base_rms: float) -> tuple[FittedParameter, ...]:
    """Parameters of a fit with intervals of a bootstrap of the score, each resample one Newton step from the optimum.

    Notes
    -----
    Drawn are branches with all their cycles: a fault of the model's form is the same in every cycle of a branch, and
    more cycles tell no more of it. What the priors hold (tolerances, calibrated numbers) is drawn from them.
    """
    bounds = fitter.bounds(fit.model)
    ends = _positive(bounds, fit.unknowns.shares, _ends(fitter, fit, cells, base_rms))
    values = [mapped(bounds, np.clip(vector, 0, 1)) for vector in (fit.unknowns.shares, *ends)]
    estimates = []
    number = -1
    for effect in fit.model.effects:
        for parameter in effect.parameters:
            number += 1
            at_bound = not 1e-6 < fit.unknowns.shares[number] < 1 - 1e-6
            note = "at the bound of what the library allows: no interval" if at_bound else ""
            value, ci_low, ci_high = (float(vector[number]) for vector in values)
            if at_bound:
                ci_low = ci_high = float("nan")
            estimates.append(FittedParameter(effect.name, parameter.name, parameter.unit, value, ci_low, ci_high, note))
    return tuple(estimates)


def _ends(fitter: Fitter, fit: Fit, cells: Truth, base_rms: float) -> tuple[Real, Real]:
    """Ends of the intervals (n_parameters,) of the parameters as shares of their bounds, to first order."""
    steps, hessian, n_blocks = score_steps(fitter, fit, cells)
    first_share = len(fit.unknowns.scales)
    share_columns = slice(first_share, first_share + len(fit.unknowns.shares))
    form = ndtri(0.5 * (1 + CONFIDENCE)) * np.sqrt(
        np.diag(_form(fitter, fit, hessian, n_blocks, cells, base_rms))[share_columns]
    )
    lower_step, upper_step = np.hypot(tails(steps, n_blocks)[:, share_columns], form)
    return fit.unknowns.shares - lower_step, fit.unknowns.shares + upper_step


def _positive(bounds: Sequence[tuple[float, float]], shares: Real, ends: tuple[Real, Real]) -> tuple[Real, Real]:
    """The ends with those of sizes that cannot be negative, and would reach zero, taken in the logarithm of the size.

    Where a size and a time constant trade in a valley of the misfit, it is wide upwards and never reaches zero.
    """
    low, high = ends[0].copy(), ends[1].copy()
    for k, (lower, _) in enumerate(bounds):
        if lower == 0 < shares[k] and low[k] <= 0:
            high[k] = max(high[k], shares[k] * np.exp(min(high[k] / shares[k] - 1, LARGEST_LOG)))
            low[k] = shares[k] * np.exp(low[k] / shares[k] - 1)
    return low, high


def unsupported(fitter: Fitter, fit: Fit, cells: Truth, base_rms: float, present: bool = False) -> str:
    """Why a fitted model supports no claim, or "": an effect that may be absent, a bound, a constant beyond the record.

    An effect may be absent where the interval of its size reaches zero; of several sizes (the amplitudes of a phase),
    where their joint interval does. Not so where it was tested against its absence already (``present``).
    """
    effect, reason = next(shortcomings(fitter, fit, cells, base_rms, present), ("", ""))
    return f"{effect}: {reason}" if effect else ""


def shortcomings(
    fitter: Fitter, fit: Fit, cells: Truth, base_rms: float, present: bool = False
) -> Iterator[tuple[str, str]]:
    """Effects of a fitted model that support no claim, each with why, as ``unsupported`` asks."""
    bounds = fitter.bounds(fit.model)
    low, high = (mapped(bounds, np.clip(end, 0, 1)) for end in _ends(fitter, fit, cells, base_rms))
    covariance = _covariance(fitter, fit, cells, base_rms)
    start = 0
    for effect in fit.model.effects:
        stop = start + len(effect.parameters)
        limits, shares, values = bounds[start:stop], fit.unknowns.shares[start:stop], fit.values[start:stop]
        sizes = [k for k, (lower, largest) in enumerate(limits) if lower <= 0 <= largest]
        for k, (parameter, value) in enumerate(zip(effect.parameters, values, strict=True)):
            if not AT_BOUND < shares[k] < 1 - AT_BOUND and (k not in sizes or limits[k][0] < 0 or shares[k] > 0.5):
                yield effect.name, f"{parameter.name} = {value:.3g} is at a bound of what the library allows"
            if parameter.record and value > fitter.problem.record[parameter.record]:
                yield effect.name, f"{parameter.name} = {value:.3g} is longer than the record"
        if not present and len(sizes) == 1 and not (low[start + sizes[0]] > 0 or high[start + sizes[0]] < 0):
            yield effect.name, f"the interval of {effect.parameters[sizes[0]].name} reaches zero"
        if not present and len(sizes) > 1:
            zero = np.array([unmapped([limits[k]], [0.0])[0] for k in sizes])
            columns = start + np.array(sizes)
            distance = (shares[sizes] - zero) @ np.linalg.solve(
                covariance[np.ix_(columns, columns)], shares[sizes] - zero
            )
            if distance < 2 * gammaincinv(0.5 * len(sizes), CONFIDENCE):
                yield effect.name, "the joint interval of its amplitudes reaches zero"
        start = stop


def _covariance(fitter: Fitter, fit: Fit, cells: Truth, base_rms: float) -> Real:
    """Covariance (n_parameters, n_parameters) of the shares of the bounds: of the resampled optima, and of the form."""
    steps, hessian, n_blocks = score_steps(fitter, fit, cells)
    share_columns = slice(len(fit.unknowns.scales), len(fit.unknowns.scales) + len(fit.unknowns.shares))
    resampled_covariance = np.atleast_2d(np.cov(steps[:, share_columns], rowvar=False)) * _student(n_blocks) ** 2
    return resampled_covariance + _form(fitter, fit, hessian, n_blocks, cells, base_rms)[share_columns, share_columns]


def _form(fitter: Fitter, fit: Fit, hessian: Real, n_blocks: int, cells: Truth, base_rms: float) -> Real:
    """Covariance (n_unknowns, n_unknowns) by the form of the model.

    A share FORM of its own size for what grows with an effect; and an error of any shape (``form_variance``), as if the
    data held all that priors do.
    """
    covariance = form_variance(fitter, fit, n_blocks, cells, base_rms) * np.linalg.inv(hessian)
    first_share = len(fit.unknowns.scales)
    for k, ((low, high), share) in enumerate(zip(fitter.bounds(fit.model), fit.unknowns.shares, strict=True)):
        if low <= 0 <= high:
            covariance[first_share + k, first_share + k] += (FORM * (share + low / (high - low))) ** 2
    return np.asarray(covariance, float)


def form_variance(fitter: Fitter, fit: Fit, n_blocks: int, cells: Truth, explained_rms: float) -> float:
    """How many times the noise moves a fit, the form of the model does, as a variance.

    Of an error of any shape, alike in a branch and independent between branches, of the size that a share FORM of all
    that is explained (``explained_rms`` [floors]) has, or less: most of it would be left in the residual.
    """
    data = fitter.problem.data
    reduced_chi_square = np.mean(((data.angle - fit.predicted) / data.sigma)[cells] ** 2)
    shape = min((FORM * explained_rms) ** 2, max(float(reduced_chi_square), STRUCTURE**2) - 1)
    return float(shape * int(cells.sum()) / n_blocks)


def determined(fitter: Fitter, fit: Fit, cells: Truth, base_rms: float) -> bool:
    """Whether no interval of an effect that has a limit case reaches an end of its parameter's bounds.

    Else the data leave open how far from the limit it is.
    """
    low, high = _ends(fitter, fit, cells, base_rms)
    start = 0
    for effect in fit.model.effects:
        columns = slice(start, start + len(effect.parameters))
        start = columns.stop
        if effect.limit_case and (np.any(low[columns] <= 0) or np.any(high[columns] >= 1)):
            return False
    return True


def score_steps(fitter: Fitter, fit: Fit, cells: Truth) -> tuple[Real, Real, int]:
    """Newton steps (RESAMPLES, n_unknowns) to the optima of resampled branches, the Hessian, and how many there are.

    Raises
    ------
    LinAlgError : if the Hessian with its priors is singular.

    Source
    ------
    Scores of n branches of a fit sum to what its priors pull: their resampled variance is (n - 1)/n of that of new
    branches. Widened by n/(n - 1), Cameron, Gelbach, Miller, Review of Economics and Statistics 90 (2008) 414.
    """
    data = fitter.problem.data
    penalty = fitter.penalty(fit.unknowns)
    rows = fit.jacobian[cells] / fit.sigma[cells][:, None]
    misfit = ((data.angle - fit.predicted) / fit.sigma)[cells]
    _, block = np.unique(data.branch[cells], return_inverse=True)
    n_blocks, k = int(block.max()) + 1, rows.shape[1]
    products = np.zeros((n_blocks, k, k + 1))
    for b in range(n_blocks):
        block_rows = rows[block == b]
        products[b, :, :k], products[b, :, k] = block_rows.T @ block_rows, block_rows.T @ misfit[block == b]
    total, score = products[:, :, :k].sum(axis=0), products[:, :, k].sum(axis=0)
    resampled_scores = n_blocks * resampled_means(products[:, :, k], RESAMPLES, SEED)
    widened = score + (resampled_scores - score) * np.sqrt(n_blocks / max(n_blocks - 1, 1))
    widened += penalty * np.random.default_rng(SEED).standard_normal((RESAMPLES, k))
    hessian = total + np.diag(penalty**2) + 1e-9 * np.trace(total) / max(k, 1) * np.eye(k)
    pull = penalty**2 * (fit.unknowns.flat - fitter.centre(fit.model, fit.unknowns))
    steps = np.linalg.solve(hessian, (widened - pull).T).T
    return steps, hessian, n_blocks


def tails(steps: Real, n_blocks: int) -> Real:
    """How far resampled optima reach down and up (2, n_unknowns), in the confidence of intervals.

    About the median step, which is not zero where a bound or the last steps of the fit hold it; of few branches widened
    as Student's t is over the normal distribution. The k-th least of R resamples stands at the level k/(R + 1),
    Davison, Hinkley, Bootstrap Methods and Their Application (1997), section 2.4.
    """
    ends = 50 * (1 - CONFIDENCE), 50 * (1 + CONFIDENCE)
    from_median = steps - np.median(steps, axis=0)
    return np.abs(np.percentile(from_median, ends, axis=0, method="weibull")) * _student(n_blocks)


def _student(n_blocks: int) -> float:
    """How much wider an interval is for the few blocks that it rests on."""
    tail = 0.5 * (1 + CONFIDENCE)
    return float(stdtrit(max(n_blocks - 1, 2), tail) / ndtri(tail))
