"""What a refit of calibrated numbers says: within plausible ranges, with intervals, or by numbers not believed."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc, ndtri  # scipy.stats is slow to import

from pipeline.arrays import Truth
from pipeline.constant_kinds import Shown
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import SCALE_REACH, Fit
from pipeline.identification.selection.evidence import Evidence
from pipeline.statistics.resampling import CONFIDENCE

LAWS = (
    "deflection of the pins' contacts",
    "deflection of the output's contacts",
    "curvature of the laws of all contacts",
)
"""Titles of the scales after those of the calibrated numbers."""
ENTANGLED_SHARE: Shown = 0.9
"""Correlation from which only a combination of two numbers is determined."""
LEARNT: Shown = 0.7
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


def calibrated_numbers(fitter: Fitter, fit: Fit, evidence: Evidence) -> tuple[CalibratedNumber, ...]:
    """All scales of a fit, with intervals and what is determined of them."""
    n, problem = len(fit.unknowns.scales), fitter.problem
    if not n:
        return ()
    deviation, covariance = evidence.deviations[:n], evidence.unknowns[1][:n, :n]
    correlation = covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    keys, (low, high) = (*problem.calibrated_keys, *LAWS), problem.scale_range
    leaves = replace(fit.unknowns, reach=problem.scale_range).at_reach
    reach = float(ndtri(0.5 * (1 + CONFIDENCE))) * deviation
    numbers = []
    for k, scale in enumerate(fit.unknowns.scales):
        note = ""
        if deviation[k] > LEARNT * problem.scale_spread[k]:
            note = "not determined by these data: its range alone holds it"
        partners = [j for j in range(n) if j != k and abs(correlation[k, j]) > ENTANGLED_SHARE]
        if partners:
            note = f"only a combination with {' and '.join(keys[j] for j in partners)} is determined"
        factor, ci_low, ci_high = np.exp([scale, scale - reach[k], scale + reach[k]]).tolist()
        plausible = float(np.exp(low[k])), float(np.exp(high[k]))
        numbers.append(CalibratedNumber(keys[k], factor, ci_low, ci_high, *plausible, bool(leaves[k]), note))
    return tuple(numbers)


def refit_with_free_numbers(fitter: Fitter, fit: Fit, cells: Truth) -> Fit | None:
    """The model refitted with its numbers free.

    None where no number is at an end of its range, or where the refit finds no equilibrium.
    """
    if not np.any(fit.unknowns.at_reach):
        return None
    reach = SCALE_REACH * np.array([[-1.0], [1.0]])
    refit = fitter.fit(fit.model, cells, replace(fit.unknowns, reach=reach))
    return refit if refit.sound and np.isfinite(refit.cost) else None


def tolerance_share(fit: Fit, evidence: Evidence) -> float:
    """Share of the study's units whose tolerances lie as far from the usual unit as those fitted; 1 without any.

    Modes of the tolerances have unit variance, so their sum of squares is chi-square with as many degrees of freedom.
    Their posterior mean is taken: what the structure beside the model takes up is no tolerance.
    """
    n_modes = len(fit.unknowns.modes)
    if not n_modes:
        return 1.0
    modes = evidence.unknowns[0][-n_modes:]
    return float(chdtrc(n_modes, modes @ modes))


def implausible(numbers: Sequence[CalibratedNumber]) -> str:
    """The numbers that leave their ranges, in words."""
    return " and ".join(
        f"{number.key} x {number.factor:.3g} (plausible {number.plausible_low:.3g} to {number.plausible_high:.3g})"
        for number in numbers
        if number.leaves
    )
