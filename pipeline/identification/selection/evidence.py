"""How probable the data are under a fitted model: one covariance, one score, for fitted cells and for unused ones.

Near a fit the effects, the calibrated numbers and the tolerances with their priors are one linear Gaussian problem. The
sizes of what is correlated beyond the model (``covariance``), their reach and the correlation of the noise are those of
the largest evidence of each model. What differs between cycles is known by the repeats of a unit alone: where these
agree its size is none.

Source: evidence of a linear Gaussian model: MacKay, Neural Computation 4 (1992) 415; variance of a random effect by its
largest marginal likelihood: Harville, J. Am. Stat. Assoc. 72 (1977) 320.
"""

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import replace
from functools import cached_property
from itertools import product

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.special import chdtrc, gammaincinv, log_ndtr, logsumexp

from pipeline.arrays import Real, Truth
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import Fit
from pipeline.identification.selection.covariance import (
    CORRELATIONS,
    REACHES,
    SIZES,
    Correlation,
    Covariance,
    Structure,
    WhiteFeatures,
)
from pipeline.statistics.resampling import CONFIDENCE

PRIOR_WIDTHS = (1.0, 1 / 4, 1 / 16, 1 / 64, 1 / 256)
"""Standard deviations of the prior of a size, as shares of the widest: ``OPEN_SHARE`` of the range of the size.

All five are equally probable. Usual sizes are a hundred to two thousand times smaller than their range."""
FIRST = Structure(SIZES[2], SIZES[2], REACHES[1], CORRELATIONS[0])
"""From where the structure of the largest evidence is sought."""


class Evidence:
    """The evidence of one fitted model, linear about the fit.

    Attributes
    ----------
    structure : beside the model, of the largest evidence.
    widths : (n_unknowns,) of the priors, as shares of the widest; a size has the most probable one.
    cost_of_widths : logarithm of the evidence with these widths over the average of the evidence with all widths.
    value : logarithm of the evidence; sizes that cannot be negative by a truncated integral.
    promised_value : the same with what the linear problem promises away from the fit, which ``value`` may not count.
    """

    def __init__(
        self, covariance: Covariance, fitter: Fitter, fit: Fit, structure: Structure | None = None, held: bool = False
    ):
        """The structure is sought from ``structure``, or is ``held`` as that."""
        self.covariance, self.fit, self.bounds = covariance, fit, fitter.bounds(fit.model)
        cells, self.spread = covariance.cells, 1 / fitter.penalty(fit.unknowns)
        jacobian = fit.jacobian * self.spread
        self.centre = fitter.centre(fit.model, fit.unknowns)
        deviation = (fit.unknowns.flat - self.centre) / self.spread
        self.jacobian, self.angle = jacobian[cells], fitter.problem.data.angle[cells]
        self.misfit = self.angle - (fit.predicted_angle - jacobian @ deviation)[cells]
        self.of_fit, self.counts_promise = deviation, True
        self._products: dict[tuple[float, Correlation], tuple[Real, Real]] = {}
        self._grams: dict[tuple[float, Correlation, float], Real] = {}
        self._white_columns: dict[Correlation, Real] = {}
        self._known_values: dict[Structure, float] = {}
        self._systems: dict[Structure, tuple[Real, Real]] = {}
        self.widths, self.cost_of_widths = np.ones(jacobian.shape[1]), 0.0
        self.structure = structure if structure and held else self._most_probable_structure(structure or FIRST)
        self._narrow_priors()
        self._positive = self._log_share_above_zero()
        self.value = self.promised_value = self._value(self.structure) + self._positive

    def _narrow_priors(self) -> None:
        """Set the prior of the sizes of each effect to its most probable width, one effect after the other.

        The evidence is the average over all widths. ``cost_of_widths`` is by how much it is less than at these widths.
        """
        for sizes in self._sizes_by_effect():
            values = []
            for width in PRIOR_WIDTHS:
                self.widths[sizes] = width
                values.append(self._log_evidence(self.structure, self._everything) + self._log_share_above_zero())
            self.widths[sizes] = PRIOR_WIDTHS[int(np.argmax(values))]
            self.cost_of_widths += float(np.log(len(PRIOR_WIDTHS)) + max(values) - logsumexp(values))
        self._known_values.clear()

    def _sizes_by_effect(self) -> list[list[int]]:
        """Columns of the sizes of each effect, the parameters that can be zero."""
        columns = list(enumerate(self.bounds, len(self.fit.unknowns.scales)))
        of_effects = [columns[place] for _, place in self.fit.model.places]
        return [[column for column, (low, high) in one if low <= 0 <= high] for one in of_effects]

    @cached_property
    def _everything(self) -> Truth:
        return np.ones(len(self.misfit), bool)

    def _features(self, structure: Structure, is_chosen: Truth | None = None) -> WhiteFeatures:
        chosen = self._everything if is_chosen is None else is_chosen
        return self.covariance.white_features(structure.reach, structure.correlation, chosen)

    def _whitened(self, columns: Real, structure: Structure) -> Real:
        return self.covariance.whiten(columns, structure.correlation)

    def _all_products(self, structure: Structure, is_chosen: Truth) -> tuple[Real, Real]:
        """Products of the whitened columns of chosen cells (n,), and of each position's own features with them.

        The columns are the features that positions share, the jacobian, and what is missed.
        """
        key, is_whole = (structure.reach, structure.correlation), bool(np.all(is_chosen))
        if is_whole and key in self._products:
            return self._products[key]
        features = self._features(structure, is_chosen)
        if structure.correlation not in self._white_columns:
            columns = np.column_stack([self.jacobian, self.misfit])
            self._white_columns = {structure.correlation: self._whitened(columns, structure)}  # of one at a time
        of_model = self._white_columns[structure.correlation] * is_chosen[:, None]
        cross = of_model.T @ features.shared
        products = np.block([[features.shared_products, cross.T], [cross, of_model.T @ of_model]])
        own_products = np.hstack([features.own_products, features.own.T @ of_model])
        if is_whole:
            self._products[key] = products, own_products
        return products, own_products

    def _gram(self, structure: Structure, is_chosen: Truth) -> Real:
        """The products of all columns, the features that each position has by itself taken up."""
        key, is_whole = (structure.reach, structure.correlation, structure.own_size), bool(np.all(is_chosen))
        if is_whole and key in self._grams:
            return self._grams[key]
        products, own_products = self._all_products(structure, is_chosen)
        variances = self._features(structure, is_chosen).variances(self.covariance.own_variance(structure))
        gram: Real = products - own_products.T @ (variances[:, None] * own_products)
        if is_whole:
            self._grams[key] = gram
        return gram

    def _solved(self, structure: Structure, is_chosen: Truth) -> tuple[Real, Real, Real, float]:
        """Prior deviations (n_columns,) of shared features and unknowns, their precision's factor, solution and square.

        Of chosen cells (n,). The solution is that of the factor for what is missed, and the square that of the misfit
        in noise. Unknowns are last: the end of the factor is that of their own precision, whatever the features are.
        """
        gram = self._gram(structure, is_chosen)
        spread = np.append(self.covariance.spreads(structure), self.widths)
        precision = spread[:, None] * gram[:-1, :-1] * spread
        precision[np.diag_indices_from(precision)] += 1.0
        factor = cholesky(precision, lower=True, overwrite_a=True)
        solution = solve_triangular(factor, spread * gram[:-1, -1], lower=True)
        return spread, factor, solution, float(gram[-1, -1])

    def _log_evidence(self, structure: Structure, is_chosen: Truth, without_promise: bool = False) -> float:
        """Logarithm of the evidence of chosen cells (n,); of several balances with a ripple each is as probable.

        Without what the linear problem promises away from the fit if asked for.
        """
        _, factor, solution, square = self._solved(structure, is_chosen)
        size = float(np.sum(np.log(np.diag(factor)))) + 0.5 * float(is_chosen.sum()) * np.log(2 * np.pi)
        size += self._features(structure, is_chosen).log_size(self.covariance.own_variance(structure))
        scale = self.covariance.log_scale(structure.correlation, is_chosen)
        choice = float(np.sum(np.log(self.fit.balances[self.covariance.cells][is_chosen])))
        value = -0.5 * (square - solution @ solution) - size + scale - choice - self.cost_of_widths
        return float(value) - (self._gain_from_fit(factor, solution) if without_promise else 0.0)

    def _gain_from_fit(self, factor: Real, solution: Real) -> float:
        """Half the square of the distance from the fit to the most probable unknowns, in their posterior deviations."""
        n_features = len(solution) - len(self.widths)
        of_unknowns = factor[n_features:, n_features:]
        return 0.5 * float(np.sum((of_unknowns.T @ (self.of_fit / self.widths) - solution[n_features:]) ** 2))

    def _value(self, structure: Structure) -> float:
        if structure not in self._known_values:
            known = self._log_evidence(structure, self._everything, without_promise=not self.counts_promise)
            self._known_values[structure] = known
        return self._known_values[structure]

    def _most_probable_structure(self, start: Structure) -> Structure:
        """The structure of the largest evidence; its products are kept: those of all take 50 MB for each model."""
        self._products, self._grams, self._white_columns = dict(self._products), {}, {}
        structure = self.best_structure(self._value, start)
        key = structure.reach, structure.correlation
        self._products, self._grams, self._white_columns = {key: self._products[key]}, {}, {}
        return structure

    def best_structure(
        self,
        value: Callable[[Structure], float],
        start: Structure,
        largest_size: float = np.inf,
        largest_between_cycles: float = np.inf,
        largest_shared: float = np.inf,
    ) -> Structure:
        """The structure of the largest ``value``, not beyond some sizes.

        It is sought from every correlation, since a correlation and a size can replace each other: from one alone no
        step may lead to the best. The same holds for the parts of all positions and of each, bounded together.
        """
        half = float(largest_size / np.sqrt(2))
        shares = [(half, half)] if np.isinf(largest_size) else [(half, half), (largest_size, 0.0), (0.0, largest_size)]
        starts = [
            replace(start, common=min(start.common, common), own_size=min(start.own_size, own), correlation=correlation)
            for correlation, (common, own) in product(self.covariance.correlations, shares)
        ]
        largest_sizes = min(largest_shared, largest_size), largest_size, largest_between_cycles
        return max((self.covariance.best_nearby(value, one, largest_sizes) for one in starts), key=value)

    @cached_property
    def unknowns(self) -> tuple[Real, Real]:
        """Mean and covariance of the unknowns about the centre of the priors, in standard deviations of the widest."""
        return self._unknowns_beside(self.structure)

    def _unknowns_beside(self, structure: Structure) -> tuple[Real, Real]:
        (_, factor, solution, _), k = self._solved(structure, self._everything), len(self.widths)
        of_unknowns = factor[len(factor) - k :, len(factor) - k :]
        inverse = solve_triangular(of_unknowns, np.eye(k), lower=True)
        mean, covariance = inverse.T @ solution[len(solution) - k :], inverse.T @ inverse
        return self.widths * mean, self.widths[:, None] * covariance * self.widths

    def without_promise(self) -> "Evidence":
        """The evidence by Laplace's method at the unknowns of the fit, with the structure that is most probable there.

        It lacks the gain that the linear problem predicts between the fit and its most probable unknowns: half the
        square of their distance in standard deviations of the posterior.
        """
        at_fit = copy(self)
        for name in ("unknowns", "training", "predicting_structure", "predictive"):
            vars(at_fit).pop(name, None)
        at_fit.counts_promise, at_fit._known_values = False, {}
        at_fit.structure = at_fit._most_probable_structure(self.structure)
        at_fit._positive = at_fit._log_share_above_zero()
        at_fit.value = at_fit._value(at_fit.structure) + at_fit._positive
        return at_fit

    @property
    def promise(self) -> float:
        """Gain of the logarithm of the evidence that ``value`` counts away from the fit."""
        return self._gain_from_fit(*self._solved(self.structure, self._everything)[1:3]) if self.counts_promise else 0.0

    def log_density(self, fit: Fit) -> float:
        """Logarithm of the density of the data and of the unknowns of a fit of the same model, up to a constant."""
        at_unknowns = copy(self)
        at_unknowns.misfit = self.angle - fit.predicted_angle[self.covariance.cells]
        at_unknowns.jacobian, at_unknowns.widths, at_unknowns._products = self.jacobian[:, :0], self.widths[:0], {}
        at_unknowns._grams, at_unknowns._white_columns = {}, {}
        deviation = (fit.unknowns.flat - self.centre) / (self.spread * self.widths)
        return at_unknowns._log_evidence(self.structure, self._everything) - 0.5 * float(deviation @ deviation)

    @property
    def most_probable(self) -> Real:
        """The most probable unknowns (n_unknowns,) in their units."""
        return np.asarray(self.centre + self.spread * self.unknowns[0])

    def drawn(self, n_draws: int) -> Real:
        """Unknowns (n_draws, n_unknowns) of the posterior, in their units, the same at every call."""
        deviations = np.random.default_rng(n_draws).multivariate_normal(*self.unknowns, n_draws, method="cholesky")
        return np.asarray(self.centre + self.spread * deviations)

    @property
    def tolerance_share(self) -> float:
        """Share of the study's units whose tolerances lie as far from the usual unit as those fitted; 1 without any."""
        n_modes = len(self.fit.unknowns.modes)
        # modes have unit variance; their posterior mean is taken: what the structure takes up is no tolerance
        return float(chdtrc(n_modes, np.sum(self.unknowns[0][-n_modes:] ** 2))) if n_modes else 1.0

    def _log_share_above_zero(self) -> float:
        """Logarithm of the share of the posterior of sizes that cannot be negative, over that of their prior."""
        mean, covariance = self._unknowns_beside(self.structure)
        first_share = len(self.fit.unknowns.scales)
        columns = [first_share + k for k, (low, _) in enumerate(self.bounds) if low == 0]
        return float(sum(log_ndtr(mean[k] / np.sqrt(covariance[k, k])) + np.log(2) for k in columns))

    def log_evidence_up_to(self, largest_size: float, largest_between_cycles: float) -> float:
        """The logarithm of the evidence with structure beside the model, and between cycles, up to a size for each."""
        if self.structure.size <= largest_size and self.structure.cycle_size <= largest_between_cycles:
            return self.value
        structure = self.best_structure(self._value, self.structure, largest_size, largest_between_cycles)
        return self._value(structure) + self._positive

    @cached_property
    def training(self) -> Mapping[int, float]:
        """By number of a part, the logarithm of the evidence of all other parts."""
        parts = self.covariance.parts
        return {int(part): self._log_evidence(self.structure, parts != part) for part in np.unique(parts)}

    @cached_property
    def predicting_structure(self) -> Structure:
        """The structure of the largest evidence without the part that all positions share.

        Other positions would show that part, so that a model without the effect would predict as well as one with it.
        """
        return self.best_structure(self._value, self.structure, largest_shared=SIZES[0])

    @cached_property
    def predictive(self) -> Real:
        """Log density of the cells of every part (n_parts,), predicted from all others: the score of unused data."""
        parts, structure = self.covariance.parts, self.predicting_structure
        others = [self._log_evidence(structure, parts != part) for part in np.unique(parts)]
        return np.asarray(self._log_evidence(structure, self._everything) - np.array(others))

    def distance(self, effect: str, without: "Evidence | None" = None) -> float:
        """How far the sizes of an effect of the model are from zero, over the radius of their 95 % region.

        The sizes are the parameters that can be zero; beyond 1 the region excludes zero. The others, shapes, are held
        where they are most probable: of an effect of no size they mean nothing.

        Parameters
        ----------
        without : the evidence of the model without this effect, if that was fitted.

        Raises
        ------
        KeyError : the model has no such effect.

        Notes
        -----
        Its square is twice the logarithm of the ratio of two densities of the sizes: where they are most probable, and
        at zero. By the identity of Savage and Dickey (Dickey, Ann. Math. Stat. 42 (1971) 204) the density at zero over
        that of the prior equals the evidence without the effect over that with it. If the model without the effect
        was fitted, this identity is used, because the density may be far from normal: that the torque has a zero
        offset can be certain, although every value between two rows fits as well. Otherwise a normal density is used.
        """
        (mean, covariance), first_share = self.unknowns, len(self.fit.unknowns.scales)
        place = {member.name: place for member, place in self.fit.model.places}[effect]
        is_size = np.array([low <= 0 <= high for low, high in self.bounds[place]])
        of_effect = slice(first_share + place.start, first_share + place.stop)
        precision = np.linalg.inv(covariance[of_effect, of_effect])
        sizes, shapes = mean[of_effect][is_size], mean[of_effect][~is_size]
        square = sizes @ precision[np.ix_(is_size, is_size)] @ sizes
        if without is not None:
            gain = self.cost_of_widths - without.cost_of_widths
            gain += self._value(self.structure) - without._value(self.structure)
            narrowing = np.linalg.slogdet(precision)[1] + 2 * np.sum(np.log(self.widths[of_effect]))
            square = max(2 * gain + narrowing + shapes @ shapes, 0.0)
        return float(np.sqrt(square / (2 * gammaincinv(0.5 * len(sizes), CONFIDENCE))))

    @property
    def deviations(self) -> Real:
        """Standard deviations of the unknowns (n_unknowns,) in their units."""
        return self.spread * np.sqrt(np.diag(self.unknowns[1]))

    def fall(self, structure: Structure) -> float:
        """Fall of the logarithm of the evidence from the structure of the largest one to another."""
        return self._value(self.structure) - self._value(structure)

    def information(self, changes: Real, structure: Structure | None = None) -> Real:
        """Products (n, n) of changes (n_cells, n) [arcmin] of all cells, under noise, structure and the model's priors.

        A change whose product with itself is lambda is seen at the square root of lambda standard deviations. The
        structure is that of the largest evidence unless another is given.
        """
        structure = structure or self.structure
        white = self._whitened(changes[self.covariance.cells], structure)
        left, products = self._beside_own_features(white, structure)
        followed_part = solve_triangular(self._system(structure)[1], products, lower=True)
        return np.asarray(white.T @ left - followed_part.T @ followed_part)

    def scores(self, changes: Real) -> Real:
        """Products (n_blocks, n) of changes (n_cells, n) with what is left of the cells, branch by branch.

        What unknowns and structure take up of the changes within their priors is taken off.
        """
        covariance, structure = self.covariance, self.structure
        white = self._whitened(np.column_stack([self.misfit, changes[covariance.cells]]), structure)
        spread, factor = self._system(structure)
        amounts = spread[:, None] * cho_solve((factor, True), self._beside_own_features(white, structure)[1])
        white -= np.hstack([self._features(structure).shared, self._whitened(self.jacobian, structure)]) @ amounts
        left = self._features(structure).left(white, covariance.own_variance(structure))
        _, block = np.unique(covariance.data.block[covariance.cells], return_inverse=True)
        products = left[:, 1:] * left[:, :1]
        return np.array([products[block == number].sum(axis=0) for number in range(block.max() + 1)])

    def _beside_own_features(self, white: Real, structure: Structure) -> tuple[Real, Real]:
        """Whitened columns (n, m) less what own features explain, and products (n_columns, m) of the rest.

        The products are those with unknowns and shared features, each scaled by its standard deviation.
        """
        features = self._features(structure)
        left = features.left(white, self.covariance.own_variance(structure))
        products = np.vstack([features.shared.T @ left, self._whitened(self.jacobian, structure).T @ left])
        return left, self._system(structure)[0][:, None] * products

    def _system(self, structure: Structure) -> tuple[Real, Real]:
        """Standard deviations of unknowns and features (n_columns,), and the factor of their posterior's precision."""
        if structure not in self._systems:
            self._systems[structure] = self._solved(structure, self._everything)[:2]
        return self._systems[structure]
