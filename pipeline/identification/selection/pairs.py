"""Which two effects together promise most: neither of them need be the best one alone."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from pipeline.arrays import Real, Truth
from pipeline.constant_kinds import Shortcut
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import Fit, Vector, shares_of_zero
from pipeline.identification.fitting.problem import Candidate, Model
from pipeline.identification.selection.screening import Promise, Screening

LARGEST_AMOUNT: Shortcut = 1.5
"""Size of an effect, in that which it would need alone, up to which its change of the curves is scaled."""


@dataclass(frozen=True)
class _Probe:
    """One effect at the size that it would need alone.

    Attributes
    ----------
    shares : (n_parameters,) of its bounds there.
    zero : (n_parameters,) without the effect, of parameters that grow with it; elsewhere as ``shares``.
    change : (n_cells + n_priors,) of the curves [sigmas], less what the base can follow.
    """

    effect: Candidate
    shares: Real
    zero: Real
    change: Real

    def shares_at(self, amount: float) -> Real:
        """Shares of the bounds at a share of this size."""
        return np.clip(self.zero + amount * (self.shares - self.zero), 0.0, 1.0)


def promising_pairs(
    fitter: Fitter,
    cells: Truth,
    base: Fit,
    promises: Mapping[str, Promise],
    effects: Mapping[str, Candidate],
    count: int,
    least_fall: float,
) -> list[tuple[Model, Vector]]:
    """The ``count`` pairs that leave least of the base's misfit, each with a start of its fit.

    Two sizes of at least zero are fitted linearly for every two effects, beside all that the base fits. A pair that
    lowers the sum of squares, in the noise, by less than ``least_fall`` cannot be named and is not fitted.
    """
    screening = Screening(fitter, cells, base, base.sigma)
    probes = [probe for name, promise in promises.items() for probe in _probes(screening, effects[name], promise)]
    goal = screening.unfollowed_part(screening.residual_left)
    ranked_pairs, in_noise = [], base.cost / max(float(goal @ goal), 1e-300)
    for first_probe, second in combinations(probes, 2):
        if first_probe.effect is not second.effect:
            amounts = _amounts(first_probe.change, second.change, goal)
            goal_left = goal - amounts[0] * first_probe.change - amounts[1] * second.change
            ranked_pairs.append((float(goal_left @ goal_left), first_probe, second, amounts))
    best_vectors: dict[str, tuple[Model, Vector]] = {}
    for misfit_left, first_probe, second, amounts in sorted(ranked_pairs, key=lambda pair: pair[0]):
        if (float(goal @ goal) - misfit_left) * in_noise < least_fall:
            break
        model = Model((first_probe.effect, second.effect))
        shares = np.concatenate([first_probe.shares_at(amounts[0]), second.shares_at(amounts[1])])
        start = replace(base.unknowns, shares=shares)
        best_vectors.setdefault(model.name, (model, start))
        if len(best_vectors) == count:
            break
    return list(best_vectors.values())


def _probes(screening: Screening, effect: Candidate, promise: Promise) -> list[_Probe]:
    """The effect at each of its starts, beside the base as it stands."""
    bounds = screening.fitter.problem.bounds(effect)
    evaluations = []
    for start in promise.starts:
        shares = start.shares[len(screening.base.unknowns.shares) :]
        zero = shares_of_zero(bounds, shares)
        change = screening.change(effect, shares)
        change = None if change is None else screening.unfollowed_part(change)
        if change is not None and change @ change > 0:
            evaluations.append(_Probe(effect, shares, zero, change))
    return evaluations


def _amounts(change: Real, second_change: Real, goal: Real) -> tuple[float, float]:
    """Least-squares amounts of two changes in [0, ``LARGEST_AMOUNT``]: inside, or on the edge that leaves least."""
    gram = np.array(
        [[change @ change, change @ second_change], [change @ second_change, second_change @ second_change]]
    )
    right_side = np.array([change @ goal, second_change @ goal])
    solution = np.linalg.lstsq(gram, right_side, rcond=None)[0]
    if np.all((solution >= 0) & (solution <= LARGEST_AMOUNT)):
        return float(solution[0]), float(solution[1])
    edges = []
    for fixed_side in (0, 1):
        for value in (0.0, LARGEST_AMOUNT):
            free_amounts = np.clip(
                (right_side[1 - fixed_side] - gram[0, 1] * value) / gram[1 - fixed_side, 1 - fixed_side],
                0.0,
                LARGEST_AMOUNT,
            )
            edges.append((value, float(free_amounts)) if fixed_side == 0 else (float(free_amounts), value))
    return min(
        edges, key=lambda corner: float(np.array(corner) @ gram @ np.array(corner) - 2 * right_side @ np.array(corner))
    )
