"""What each effect promises before it is fitted: secants of its parameters beside all that is fitted already."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.optimize import lsq_linear

from pipeline.arrays import Real, Truth
from pipeline.constant_kinds import Shortcut, ShortcutCount, ShortcutGrid
from pipeline.identification.fitting.fitter import FIRST_ITERATIONS, Fitter
from pipeline.identification.fitting.parameters import Fit, Vector, values_at_shares
from pipeline.identification.fitting.problem import Candidate, Model
from pipeline.identification.selection.ripples import ripple_starts

STEPS: ShortcutGrid = (1e-3, 1e-2, 1e-1)
"""Lengths of the secants, as shares of the way from no effect to a bound."""
SHAPES: ShortcutGrid = (0.1, 0.35, 0.6, 0.85)
"""Shares of the bounds at which parameters that leave no trace of an absent effect are looked at."""
REACH: Shortcut = 4.0
"""Lengths of its secant up to which an effect is extrapolated."""
LOOKED_AT: ShortcutCount = 12
"""Effects that are looked at more closely beside another one, those that explain most by their secants."""
STARTS: ShortcutCount = 3
"""Most starts from which an effect is fitted: senses of its parameters, and bases."""
RIVAL: Shortcut = 3.0
"""Misfit of a further start in that of the best beyond which it is left out."""
RADII: ShortcutGrid = (0.15, 0.05, 0.35)
"""Where an effect is looked at besides, in shares of its bounds: it bends with its size."""
PHASES: ShortcutCount = 8
"""Phases that are looked at, all at the first of these distances: an effect bends with its phase, too."""
BEST_DIRECTIONS: ShortcutCount = 2
"""The best of these phases, or both senses of one parameter, which are looked at at the other distances."""
PERIODIC = "periods"
"""Starts of an effect that has a period; looked at beside the first base alone, since there are many of them."""
FIRST_SHARE: Shortcut = 0.1
"""Share of its bounds by which a parameter starts off no effect in either sense."""
EDGE: Shortcut = 0.01
"""Share of its bounds from an end at which it starts at least."""


@dataclass(frozen=True)
class Promise:
    """What an effect may explain.

    Attributes
    ----------
    misfit : sum of squares left, in shares of the base's.
    starts : where fits with the effect start, the best first.
    """

    misfit: float
    starts: tuple[Vector, ...]


class Screening:
    """Looks at effects beside one fitted base, cells weighted by ``sigma`` (n_cells,) [arcmin].

    The misfit of a prediction is that after the base's unknowns (scales, parameters, tolerances) have moved as they
    can, linearly and held by their priors.
    """

    def __init__(self, fitter: Fitter, cells: Truth, base: Fit, sigma: Real):
        self.fitter, self.cells, self.base, self.sigma = fitter, cells, base, sigma
        data = fitter.problem.data
        self.positions = np.unique(data.position[cells]).tolist()
        self.weight = np.where(cells, 1 / sigma**2, 0.0)
        self.root = np.sqrt(self.weight[cells])
        self.penalty = penalty = fitter.penalty(base.unknowns)
        self.rows = np.vstack([base.jacobian[cells] * self.root[:, None], np.diag(penalty)[penalty > 0]])
        self.basis, self.triangle = np.linalg.qr(self.rows)
        self.centre = fitter.centre(base.model, base.unknowns)
        self.residual_left = self.scaled_residuals(data.angle - base.predicted_angle) - self.prior_residuals(
            base.unknowns.flat
        )
        self.base_misfit = self.square(self.unfollowed_part(self.residual_left))
        self.base_angle = fitter.predict(base.model, base.unknowns, self.positions).angle

    def of_cells(self, cells: Truth) -> "Screening":
        """The same beside the same base, of those of its cells that are among some (n_cells,)."""
        return Screening(self.fitter, self.cells & cells, self.base, self.sigma)

    def prior_residuals(self, flat: Real) -> Real:
        """Residuals of the priors at unknowns, below the cells' zeros."""
        penalty = self.penalty
        return np.concatenate([np.zeros(len(self.root)), (penalty * (flat - self.centre))[penalty > 0]])

    def scaled_residuals(self, angle: Real) -> Real:
        """Angles (n_cells,) without offsets, in sigmas of the cells that are looked at, zeros for the priors."""
        scaled_angle = self.fitter.centred_values(np.nan_to_num(angle), self.weight)[self.cells] * self.root
        return np.concatenate([scaled_angle, np.zeros(len(self.rows) - len(scaled_angle))])

    def unfollowed_part(self, values: Real) -> Real:
        """What the base's unknowns cannot follow."""
        return values - self.basis @ (self.basis.T @ values)

    def change(self, effect: Candidate, shares: Real) -> Real | None:
        """Change of the curves [sigmas] by an effect at shares of its bounds; None without an equilibrium."""
        start = self.base.unknowns.with_shares(shares)
        prediction = self.fitter.predict(Model((*self.base.model.effects, effect)), start, self.positions)
        return self.scaled_residuals(prediction.angle - self.base_angle) if prediction.sound else None

    @staticmethod
    def square(values: Real) -> float:
        """Sum of squares of values, above zero."""
        return max(float(values @ values), 1e-300)

    def starts(self, effect: Candidate) -> list[tuple[float, Vector]]:
        """Starts for an effect beside the base with their sums of squares, where an equilibrium was found."""
        if effect.starts == PERIODIC:
            return ripple_starts(self, effect)
        model = Model((*self.base.model.effects, effect))
        shapes, grows = self._shapes(effect)
        best_of_shape: dict[int, tuple[float, Real, Real]] = {}
        for shape, length in product(shapes, STEPS):
            for sense, probe in enumerate(self._probes(effect, shape, grows, length)):
                if sense not in best_of_shape or probe[0] < best_of_shape[sense][0]:
                    best_of_shape[sense] = probe
        confirmed_starts = []
        for _, shares, unknowns in best_of_shape.values():
            probes = [(self.misfit_at(model, start), start) for start in self._starts_beside_base(shares, unknowns)]
            confirmed_starts.append(min(probes, key=lambda candidate_start: candidate_start[0]))
        confirmed_starts += self._directional_starts(model, np.where(grows, shapes[0], 0.0), grows)
        return [candidate_start for candidate_start in confirmed_starts if np.isfinite(candidate_start[0])]

    def misfit_by_secants(self, effect: Candidate) -> float:
        """Least misfit by secants of an effect, which cost less than its starts; infinite without an equilibrium."""
        if effect.starts == PERIODIC:
            return min((misfit for misfit, _ in ripple_starts(self, effect)), default=np.inf)
        shapes, grows = self._shapes(effect)
        looks = product(shapes, STEPS[:0:-1])  # the smallest looks the same, or at the play alone
        probes = (probe for shape, length in looks for probe in self._probes(effect, shape, grows, length))
        return min((misfit for misfit, *_ in probes), default=np.inf)

    def _shapes(self, effect: Candidate) -> tuple[list[Real], Truth]:
        """Shares of the bounds without an effect, and which parameters grow from there; the others at ``SHAPES``."""
        bounds = np.array(self.fitter.problem.bounds(effect))
        grows = (bounds[:, 0] <= 0) & (bounds[:, 1] >= 0)
        zero = np.where(grows, -bounds[:, 0] / np.ptp(bounds, axis=1), 0.0)
        shapes = product(*(((share,) if growing else SHAPES) for share, growing in zip(zero, grows, strict=True)))
        return [np.array(shape) for shape in shapes], grows

    def _directional_starts(self, model: Model, zero: Real, grows: Truth) -> list[tuple[float, Vector]]:
        """Starts about no effect: in all directions at the first distance, in the best of them at the others."""
        directions, (first_distance, *distances) = _directions(zero, grows), RADII
        starts = [self._start_at(model, zero + first_distance * direction) for direction in directions]
        ranks = np.argsort([misfit for misfit, _ in starts], kind="stable")[:BEST_DIRECTIONS]
        return starts + [
            self._start_at(model, zero + distance * directions[k]) for k in ranks for distance in distances
        ]

    def _start_at(self, model: Model, shares: Real) -> tuple[float, Vector]:
        """Misfit and start of an effect at shares of its bounds beside the base; infinite where they are beyond."""
        start = self.base.unknowns.with_shares(shares)
        return self.misfit_at(model, start) if np.all((shares > 0) & (shares < 1)) else np.inf, start

    def _starts_beside_base(self, shares: Real, scale_step: Real) -> list[Vector]:
        """The effect beside the base as it stands, and as it would move."""
        base = self.base.unknowns
        return [unknowns.with_shares(shares) for unknowns in (base.like(base.flat + scale_step), base)]

    def misfit_at(self, model: Model, start: Vector) -> float:
        """Misfit of a model's prediction; infinite where an equilibrium was not found."""
        prediction = self.fitter.predict(model, start, self.positions)
        flat = np.concatenate([start.scales, start.shares[: len(self.base.unknowns.shares)], start.modes])
        data = self.fitter.problem.data
        if not prediction.sound:
            return np.inf
        residual = self.scaled_residuals(data.angle - prediction.angle) - self.prior_residuals(flat)
        return self.square(self.unfollowed_part(residual))

    def _probes(self, effect: Candidate, shape: Real, grows: Truth, length: float) -> list[tuple[float, Real, Real]]:
        """Misfit, shares of the effect's bounds and moves of the base's unknowns, by secants from ``shape``.

        One probe for each combination of the senses in which parameters can go: gaps that open and gaps that close are
        two effects.
        """
        sides = []
        for number in np.flatnonzero(grows):
            secants = []
            for step in (-length * shape[number], length * (1 - shape[number])):
                shares = shape.copy()
                shares[number] += step
                change = self.change(effect, shares) if step else None
                secants += [] if change is None else [(step, change)]
            sides.append(secants)
        return [self._joint_fit(shape, grows, sides_of_share) for sides_of_share in product(*sides)]

    def _joint_fit(self, shape: Real, grows: Truth, secants: Sequence[tuple[float, Real]]) -> tuple[float, Real, Real]:
        """Linear least squares over one secant of each parameter and the base's unknowns."""
        steps = np.array([step for step, _ in secants])
        changes = np.column_stack([change for _, change in secants])
        unfollowed_changes = changes - self.basis @ (self.basis.T @ changes)
        amounts = lsq_linear(
            unfollowed_changes, self.unfollowed_part(self.residual_left), (0.0, REACH), method="bvls"
        ).x
        shares = shape.copy()
        shares[grows] = np.clip(shape[grows] + amounts * steps, 0.0, 1.0)
        residual = self.residual_left - changes @ amounts
        scale_step = np.linalg.lstsq(self.triangle, self.basis.T @ residual, rcond=None)[0]
        return self.square(self.unfollowed_part(residual)), shares, scale_step


def _directions(zero: Real, grows: Truth) -> list[Real]:
    """Directions (n_parameters,) from no effect: senses of one parameter, phases of two; none of other effects."""
    if len(grows) == 1 and grows[0]:
        return [np.array([sense]) for sense in (1.0, -1.0) if sense > 0 or zero[0] > 0]
    if not np.all(grows & (zero > 0)) or len(grows) > 2:
        return []
    return [np.array([np.cos(phase), np.sin(phase)]) for phase in 2 * np.pi * np.arange(PHASES) / PHASES]


def screen_effects(
    fitter: Fitter, cells: Truth, bases: Sequence[Fit], effects: Sequence[Candidate]
) -> dict[str, Promise]:
    """Promises of effects over the bases, misfits in shares of the first base's; of those that have an equilibrium."""
    screenings = [Screening(fitter, cells, base, bases[0].sigma) for base in bases if np.isfinite(base.cost)]
    promises = {}
    for effect in effects:
        screenings_of_effect = screenings[:1] if effect.starts == PERIODIC else screenings
        ranked_fits = sorted(
            (ranked_start for screening in screenings_of_effect for ranked_start in screening.starts(effect)),
            key=lambda ranked_start: ranked_start[0],
        )
        if ranked_fits:
            least_misfit = ranked_fits[0][0]
            rivals = [start for misfit, start in ranked_fits if misfit <= RIVAL * least_misfit]
            rivals = rivals if effect.starts == PERIODIC else _by_sense(rivals, fitter.problem.bounds(effect))
            promises[effect.name] = Promise(least_misfit / screenings[0].base_misfit, tuple(rivals[:STARTS]))
    return promises


def _by_sense(ranked_starts: Sequence[Vector], bounds: Sequence[tuple[float, float]]) -> list[Vector]:
    """Starts of an effect, the best of each sense of its parameters before the others.

    Neighbours end where the best of them does. In another sense calibrated numbers and tolerances may stand in for the
    effect as far as the fit goes, and what looks best from the base is not where the least sum of squares is.
    """
    senses = [
        tuple(value > 0 for value in values_at_shares(bounds, start.shares[-len(bounds) :])) for start in ranked_starts
    ]
    first_senses = [senses.index(sense) for sense in dict.fromkeys(senses)]
    return [ranked_starts[k] for k in dict.fromkeys([*first_senses, *range(len(ranked_starts))])]


def promising_effects(
    fitter: Fitter, cells: Truth, base: Fit, effects: Mapping[str, Candidate], least_fall: float
) -> list[str]:
    """Names of the effects that explain most beside a fitted base by their secants, the best first.

    Of those that promise the ``least_fall`` of the sum of squares, in the noise.
    """
    screening = Screening(fitter, cells, base, base.sigma)
    misfits = {name: screening.misfit_by_secants(effect) for name, effect in effects.items()}
    largest = screening.base_misfit * (1 - least_fall / base.cost)
    names = [name for name in misfits if misfits[name] <= largest]
    return sorted(names, key=lambda name: misfits[name])[:LOOKED_AT]


def start_from_declared(fitter: Fitter, model: Model, cells: Truth, base: Vector) -> Vector:
    """Where a fit leads that holds calibrated numbers as declared: of all senses of the last effect the best.

    The numbers are near there by their plausible ranges, while those of a base may be at the ends of them.
    """
    *others, effect = model.effects
    bounds = fitter.problem.bounds(effect)
    declared_unknowns = fitter.start(model, np.concatenate([base.shares, np.full(len(bounds), 0.5)]))
    zero = fitter.centre(model, declared_unknowns)[len(declared_unknowns.scales) :][: model.n_parameters]
    held = replace(declared_unknowns, reach=np.zeros_like(declared_unknowns.reach))
    if effect.starts == PERIODIC:
        without = fitter.fit(Model(tuple(others)), cells, replace(held, shares=base.shares), FIRST_ITERATIONS)
        ripples = ripple_starts(Screening(fitter, cells, without, without.sigma), effect)
        starts = [*ripples, (np.inf, held)]  # no wave may be found from the numbers as declared
        return replace(min(starts, key=lambda start: start[0])[1], reach=declared_unknowns.reach)
    fits = []
    for senses in product((-1.0, 1.0), repeat=len(bounds)):
        shares = np.clip(zero[-len(bounds) :] + FIRST_SHARE * np.array(senses), EDGE, 1 - EDGE)
        start = replace(held, shares=base.with_shares(shares).shares)
        fits.append(fitter.fit(model, cells, start, FIRST_ITERATIONS))
    return replace(min(fits, key=lambda fit: fit.cost).unknowns, reach=declared_unknowns.reach)
