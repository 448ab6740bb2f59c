"""What a refit of calibrated numbers says: within plausible ranges, with intervals, or by numbers not believed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc  # scipy.stats is slow to import

from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import SCALE_REACH, Fit
from pipeline.identification.fitting.problem import Model
from pipeline.identification.selection.cross_validation import Trial, trial
from pipeline.identification.selection.parameter_intervals import form_variance, score_steps, tails

Real = NDArray[np.float64]
Truth = NDArray[np.bool_]

LAWS = ("deflection of the pins' contacts", "deflection of the output's contacts")
"""Titles of the scales after those of the calibrated numbers."""
STRETCH = 2.0
"""Multiple of its plausible range (of the logarithm) up to which a calibrated number may be refitted before an effect
is claimed: ranges are stated in good faith, so a refit a little outside of one is as likely as an effect. The force
laws keep theirs, which already holds twice what the laws of the literature differ by."""
ENTANGLED = 0.9
"""Correlation from which only a combination of two numbers is determined."""
LEARNT = 0.7
"""Standard deviation over that of the prior up to which the data have determined a number."""
UNLIKELY = 1e-3
"""Share of units whose tolerances are as far from nominal as those fitted, below which they explain nothing."""


@dataclass(frozen=True)
class CalibratedNumber:
    """A refitted number of the design, as a factor of the declared one.

    Attributes
    ----------
    key : dotted name in the design file, or what a scale of a force law is.
    factor, ci_low, ci_high : fitted, with its 95 % interval.
    plausible_low, plausible_high : factors between which it is plausible.
    leaves : whether it stands at an end of that range, or beyond it.
    note : what the data leave open of it, or "".
    """

    key: str
    factor: float
    ci_low: float
    ci_high: float
    plausible_low: float
    plausible_high: float
    leaves: bool
    note: str


def calibrated_numbers(fitter: Fitter, fit: Fit, cells: Truth) -> tuple[CalibratedNumber, ...]:
    """All scales of a fit to ``cells`` (n_cells,), with intervals and what is determined of them."""
    n, problem = len(fit.unknowns.scales), fitter.problem
    if not n:
        return ()
    steps, hessian, n_blocks = score_steps(fitter, fit, cells)
    spread = tails(steps, n_blocks)[:, :n]
    covariance = np.linalg.inv(hessian)[:n, :n]
    deviation = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(deviation, deviation)
    keys, (low, high) = (*problem.calibrated, *LAWS), problem.scale_range
    leaves = replace(fit.unknowns, reach=problem.scale_range).at_reach
    numbers = []
    for k, scale in enumerate(fit.unknowns.scales):
        note = ""
        if deviation[k] > LEARNT * problem.scale_spread[k]:
            note = "not determined by these data: its range alone holds it"
        partners = [j for j in range(n) if j != k and abs(correlation[k, j]) > ENTANGLED]
        if partners:
            note = f"only a combination with {' and '.join(keys[j] for j in partners)} is determined"
        factor, ci_low, ci_high = np.exp([scale, scale - spread[0, k], scale + spread[1, k]]).tolist()
        plausible = float(np.exp(low[k])), float(np.exp(high[k]))
        numbers.append(CalibratedNumber(keys[k], factor, ci_low, ci_high, *plausible, bool(leaves[k]), note))
    return tuple(numbers)


def released(fitter: Fitter, candidate_trial: Trial, cells: Truth, stretch: float = np.inf) -> Trial | None:
    """The model refitted with its numbers free, or its calibrated ones up to ``stretch`` times their ranges.

    None where no such number stands at an end of its range, or where the refit finds no equilibrium.
    """
    limit = SCALE_REACH * np.array([[-1.0], [1.0]])
    n_freed = len(fitter.problem.calibrated) if np.isfinite(stretch) else len(candidate_trial.fit.unknowns.scales)
    if not np.any(candidate_trial.fit.unknowns.at_reach[:n_freed]):
        return None
    reach = limit
    if np.isfinite(stretch):
        factors = np.where(np.arange(len(candidate_trial.fit.unknowns.scales)) < n_freed, stretch, 1.0)
        reach = np.clip(factors * fitter.problem.scale_range, *limit)
    fit = fitter.fit(candidate_trial.fit.model, cells, replace(candidate_trial.fit.unknowns, reach=reach))
    return trial(fitter, fit, cells) if fit.sound and np.isfinite(fit.cost) else None


def tolerance_share(fitter: Fitter, fit: Fit, cells: Truth) -> float:
    """Share of the study's units whose tolerances lie as far from the usual unit as those fitted; 1 without any.

    Modes of the tolerances have unit variance, so their sum of squares is chi-square with as many degrees of freedom; a
    fit only draws them towards zero. They take up what the form of the model misses too, of all of the declared model's
    error that the fit explains: that widens what the modes of a unit may be fitted as.
    """
    n_modes = len(fit.unknowns.modes)
    if not n_modes:
        return 1.0
    _, hessian, n_blocks = score_steps(fitter, fit, cells)
    step = np.linalg.inv(hessian)  # of the unknowns, by a slope of the sum of squares
    of_data = hessian - np.diag(fitter.penalty(fit.unknowns) ** 2)
    by_noise = (step @ of_data @ step)[-n_modes:, -n_modes:]
    covariance = np.eye(n_modes) + form_variance(fitter, fit, n_blocks, cells, declared_rms(fitter, cells)) * by_noise
    modes = fit.unknowns.modes
    return float(chdtrc(n_modes, modes @ np.linalg.solve(covariance, modes)))


def declared_rms(fitter: Fitter, cells: Truth) -> float:
    """Error of the declared model over ``cells`` (n_cells,), their offsets removed, in floors; nothing is fitted."""
    data = fitter.problem.data
    angle = fitter.predict(Model(), fitter.start(Model())).angle
    error = (data.angle - angle - fitter.offsets(angle, cells, data.sigma)) / data.sigma
    return float(np.sqrt(np.mean(error[cells] ** 2)))


def implausible(numbers: Sequence[CalibratedNumber]) -> str:
    """The numbers that leave their ranges, in words."""
    return " and ".join(
        f"{number.key} x {number.factor:.3g} (plausible {number.plausible_low:.3g} to {number.plausible_high:.3g})"
        for number in numbers
        if number.leaves
    )
