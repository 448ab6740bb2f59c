"""How probable a record is under its terms and some effects: one linear Gaussian problem, zeros of all places free.

Passes of one kind repeat each other, so that cells of one kind and interval are taken together. Under torques of one
sign the same flanks carry: each interval has a zero for either sign. Passes without torque tell the lost motion and are
left out here, for few contacts carry then and change from place to place. The covariance of the points holds the noise,
the drift of the passes, what contacts that close one after the other make of the unit's errors (at each place and held
torque, alike in both senses and at all temperatures), and a structure of its own at each point and of each kind of
pass, of sizes of the largest evidence of each model. The drift is no larger than that by which repeats differ; without
repeats it is free, but each kind keeps its mean. The zeros have a flat prior: they are removed.

Source: evidence of a linear Gaussian model: MacKay, Neural Computation 4 (1992) 415; a discrepancy of no known form:
Kennedy and O'Hagan, J. R. Stat. Soc. B 63 (2001) 425.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array, dia_array
from scipy.special import gammaincinv

from pipeline.arrays import Real, Truth, Whole
from pipeline.constant_kinds import Fineness, Rounding
from pipeline.identification.measurement.turning.motion import LEVEL_SHARE
from pipeline.identification.record.passes import RecordCells, drift_of_repeats, shift_of_repeats
from pipeline.identification.record.terms import Term
from pipeline.identification.record.turn_record import TurnRecord
from pipeline.statistics.resampling import CONFIDENCE

SIZES = (0.0, 0.15, 0.3, 0.6, 1.2, 2.4, 5.0, 10.0)
"""Standard deviations of a structure that are tried, in those of the median point's noise."""
ROUNDS: Fineness = 4
"""Times that the sizes are found one after the other, at most."""
REACH = 0.15
"""Share of the angle that was turned over which the drift of a pass is alike."""
LEAST_NOISE: Rounding = 1e-5
"""Noise of a point [arcmin] at least: below what an encoder resolves."""


@dataclass(frozen=True)
class Points:
    """Cells of one kind of pass and one interval, taken together.

    Attributes
    ----------
    kind, interval : (n,)
    error : (n,) mean [arcmin].
    noise : (n,) standard deviation of that mean by what the repeats scatter [arcmin].
    level, sense, warmth : (n,) number of the held torque, sense, number of the temperature.
    zero, place : (n,) number of the zero of each, of the interval under torques of one sign; and of its interval and
        held torque.
    cells, of_cells : cells that count (n_cells,), and the point of each.
    drift : standard deviation [arcmin] of what repeats differ by over the angle; infinite without repeats.
    shift : standard deviation [arcmin] of the mean of a kind, by what whole passes that repeat each other are shifted;
        0 without repeats.
    repeats : degrees of freedom of that shift.
    """

    kind: Whole
    interval: Whole
    error: Real
    noise: Real
    level: Whole
    sense: Whole
    warmth: Whole
    zero: Whole
    place: Whole
    cells: Whole
    of_cells: Whole
    drift: float
    shift: float
    repeats: int

    def __len__(self) -> int:
        return len(self.error)

    def means(self, columns: Real) -> Real:
        """Means (n, n_columns) over the cells of each point of columns (n_record_cells, n_columns)."""
        counts = np.bincount(self.of_cells)
        return np.column_stack([np.bincount(self.of_cells, column) / counts for column in columns[self.cells].T])


def points_of(record: TurnRecord, under_load: bool = True) -> Points:
    """The points of a record, of passes under torque alone if ``under_load``, or else of all.

    The noise is that of repeats of a kind less the mean difference of each pass from the others; without repeats it is
    that of the rows about their line in a cell.
    """
    passes, all_cells = record.passes, record.cells
    under_torque = np.abs(record.levels) >= LEVEL_SHARE * record.largest_torque
    chosen_rows = np.flatnonzero(under_torque[passes.level[all_cells.owner]] | (not under_load))
    cells = RecordCells(**{name: values[chosen_rows] for name, values in vars(all_cells).items()})
    kind = passes.kind[cells.owner]
    keys, first_cells, number, count = np.unique(
        kind * record.n_intervals + cells.interval, return_index=True, return_inverse=True, return_counts=True
    )
    number = number.ravel()
    error = np.bincount(number, cells.error) / count
    of_repeats = cells.error - error[number]
    of_pass = np.bincount(cells.owner, of_repeats) / np.maximum(np.bincount(cells.owner), 1)
    residual = of_repeats - of_pass[cells.owner]
    shift, repeats = shift_of_repeats(of_pass[np.unique(cells.owner)], passes.kind[np.unique(cells.owner)])
    is_repeated = count[number] > 1
    freedom = float(np.sum((count - 1)[count > 1])) - len(np.unique(cells.owner[is_repeated]))
    if freedom > 0:
        noise = float(np.sqrt(np.sum(residual[is_repeated] ** 2) / freedom))
    else:
        noise = float(np.sqrt(np.mean(cells.scatter**2 / cells.count)))
    owner = cells.owner[first_cells]
    negative = record.levels[passes.level[owner]] < 0
    zeros = np.unique(keys % record.n_intervals + record.n_intervals * negative, return_inverse=True)[1].ravel()
    return Points(
        kind=keys // record.n_intervals,
        interval=keys % record.n_intervals,
        error=error,
        noise=max(noise, LEAST_NOISE) / np.sqrt(count),
        level=passes.level[owner],
        sense=passes.sense[owner],
        warmth=passes.temperature_group[owner],
        zero=zeros,
        place=np.unique(keys % record.n_intervals + record.n_intervals * passes.level[owner], return_inverse=True)[1],
        cells=chosen_rows,
        of_cells=number,
        drift=drift_of_repeats(of_repeats, cells, is_repeated, REACH * record.n_intervals) if freedom > 0 else np.inf,
        shift=shift,
        repeats=repeats,
    )


@dataclass(frozen=True)
class Structure:
    """What is left beside a model, in noises of the median point.

    Attributes
    ----------
    own_size, of_kind : at each point, and of each kind of pass beyond the shift of its repeats: what no term of the
        model is.
    closing : at each place and held torque, by contacts that close: the unit's own, as its zeros are.
    drift : of each kind over the angle, as passes that repeat each other differ: no structure of the unit.
    """

    own_size: float
    of_kind: float
    closing: float = 0.0
    drift: float = 0.0

    @property
    def size(self) -> float:
        """Standard deviation of what no term of the model is."""
        return float(np.hypot(self.own_size, self.of_kind))


@dataclass(frozen=True)
class Posterior:
    """A model of some terms given some points.

    Attributes
    ----------
    value : logarithm of the evidence.
    mean, covariance : of the sizes of its columns [arcmin], of those of the base first.
    """

    value: float
    mean: Real
    covariance: Real

    def distance(self, columns: slice) -> float:
        """How far some sizes are from zero, over the radius of their 95 % region."""
        mean, covariance = self.mean[columns], self.covariance[columns, columns]
        square = mean @ np.linalg.solve(covariance, mean)
        return float(np.sqrt(square / (2 * gammaincinv(0.5 * len(mean), CONFIDENCE))))


@dataclass(frozen=True, eq=False)
class Moments:
    """Sums of products of all columns, with zeros and contacts that close removed.

    Attributes
    ----------
    gram : (n, n) of the terms, the error, the kinds of passes, and the smooth columns of their drift.
    n_kept : number of columns before the smooth ones.
    log_det : logarithm of the determinant of the covariance of the points without drift and structure of kinds.
    """

    gram: Real
    n_kept: int
    log_det: float

    @cached_property
    def drift_modes(self) -> tuple[Real, Real]:
        """Eigenvalues (n_bumps,) of the smooth columns' products, and products (n_bumps, n_kept) with the others."""
        values, modes = np.linalg.eigh(self.gram[self.n_kept :, self.n_kept :])
        return np.maximum(values, 0.0), modes.T @ self.gram[self.n_kept :, : self.n_kept]

    def without_drift(self, chosen: Whole, size: float) -> tuple[Real, float]:
        """Products (n, n) of chosen columns, a drift of a size removed; and the logarithm of the determinant."""
        gram = self.gram[np.ix_(chosen, chosen)]
        if not size:
            return gram, self.log_det
        values, products = self.drift_modes
        products = products[:, chosen]
        growth = 1 + size**2 * values
        explained = products.T @ ((size**2 / growth)[:, None] * products)
        return gram - explained, self.log_det + float(np.sum(np.log(growth)))


class RecordEvidence:
    """Evidence of models of one record.

    Parameters
    ----------
    base : terms of every model.
    library : effects that may join them.
    """

    def __init__(self, points: Points, base: Sequence[Term], library: Sequence[Term]):
        self.points = points
        self.unit = float(np.median(points.noise))
        self.base = tuple(base)
        terms = [*base, *library]
        columns = [points.means(term.columns) for term in terms]
        ends = np.cumsum([0, *(part.shape[1] for part in columns)])
        self.place = {term.name: slice(int(a), int(b)) for term, a, b in zip(terms, ends[:-1], ends[1:], strict=True)}
        self.waves = {term.name: term.waves for term in terms}
        self.smooth_columns = self._smooth_columns()
        self.n_terms = int(ends[-1])
        self.columns = np.column_stack([*columns, points.error])
        means = [points.error[points.kind == kind].mean() for kind in np.unique(points.kind)]
        self.span = max(float(np.ptp(means)), self.unit)
        self.spread = self.span * np.repeat([term.prior_share for term in terms], np.diff(ends))
        self._moments = lru_cache(maxsize=256)(self._moments_of)

    def _smooth_columns(self) -> csr_array:
        """Columns (n, n_kinds + n_bumps): each kind of pass, and bumps over the angle, about a mean without repeats."""
        points = self.points
        place = points.interval / max(int(points.interval.max()), 1)
        centres = np.arange(-REACH, 1 + 1.5 * REACH, REACH)
        bumps = np.exp(-(((place[:, None] - centres) / REACH) ** 2))
        bumps /= np.linalg.norm(bumps, axis=1)[:, None]
        kind = np.unique(points.kind, return_inverse=True)[1]
        if np.isinf(points.drift):
            bumps -= _means(bumps, np.ones(len(kind)), kind)[0][kind]
        self.n_kinds = int(kind.max()) + 1
        columns = self.n_kinds + len(centres) * kind[:, None] + np.arange(len(centres))
        starts = np.arange(len(points) + 1) * (1 + len(centres))
        values = np.column_stack([np.ones(len(kind)), bumps])
        return csr_array((values.ravel(), np.column_stack([kind, columns]).ravel(), starts))

    def _moments_of(self, own_size: float, closing: float, left_out: int, parts: bytes) -> Moments:
        """Moments of the points but of one part.

        Points of one place and held torque share a deviation of the variance u: about their weighted mean they have
        their own weights w, and the mean has the variance 1/sum w + u. The means share a zero.
        """
        points = self.points
        is_chosen = np.ones(len(points), bool) if left_out < 0 else np.frombuffer(parts, np.int64) != left_out
        weight = 1 / (points.noise[is_chosen] ** 2 + (own_size * self.unit) ** 2)
        place = np.unique(points.place[is_chosen], return_inverse=True)[1].ravel()
        zero = np.empty(int(place.max()) + 1, np.int64)
        zero[place] = points.zero[is_chosen]
        zero = np.unique(zero, return_inverse=True)[1].ravel()
        columns, bumps = self.columns[is_chosen], self.smooth_columns[is_chosen]
        columns = columns - _means(columns, np.ones(len(weight)), zero[place])[0][zero[place]]
        weighted_bumps = dia_array((weight[None], [0]), shape=(len(weight),) * 2).tocsr() @ bumps
        of_places, total = _means(columns, weight, place, weighted_bumps)
        inverse_variance = 1 / (1 / total + (closing * self.unit) ** 2)
        of_zeros, of_zero = _means(of_places, inverse_variance, zero)
        mixed = weighted_bumps.T @ columns
        weighted = weight[:, None] * columns
        gram = np.block([[columns.T @ weighted, mixed.T], [mixed, (bumps.T @ weighted_bumps).toarray()]])
        gram -= of_places.T @ ((total - inverse_variance)[:, None] * of_places)
        gram -= of_zeros.T @ (of_zero[:, None] * of_zeros)
        log_det = float(np.sum(np.log(total / inverse_variance)) - np.sum(np.log(weight)) + np.sum(np.log(of_zero)))
        return Moments(gram, self.n_terms + 1 + self.n_kinds, log_det)

    def posterior(
        self, names: Sequence[str], structure: Structure, left_out: int = -1, parts: Whole | None = None
    ) -> Posterior:
        """The model of the base and some effects, given all points or those not of a part (n,)."""
        part_bytes = b"" if parts is None else np.ascontiguousarray(parts, np.int64).tobytes()
        moments = self._moments(structure.own_size, structure.closing, left_out, part_bytes)
        own_columns = self._own_columns(names)
        of_kind = float(np.hypot(structure.of_kind * self.unit, self.points.shift))
        kinds = self.n_terms + 1 + np.arange(self.n_kinds if of_kind else 0)
        chosen = np.concatenate([own_columns, kinds, [self.n_terms]])
        gram, log_det = moments.without_drift(chosen, structure.drift * self.unit)
        spread = np.concatenate([self.spread[own_columns], np.full(len(kinds), of_kind)])
        normal = np.eye(len(spread)) + spread[:, None] * gram[:-1, :-1] * spread
        right_side = spread * gram[:-1, -1]
        factor = cho_factor(normal)
        solution = cho_solve(factor, right_side)
        square = float(gram[-1, -1]) - right_side @ solution
        value = -0.5 * (square + log_det) - float(np.sum(np.log(np.diag(factor[0]))))
        n, spread = len(own_columns), spread[: len(own_columns)]
        inverse = cho_solve(factor, np.eye(len(normal), n))[:n]
        return Posterior(value, spread * solution[:n], spread[:, None] * inverse * spread)

    def _own_columns(self, names: Sequence[str]) -> Whole:
        """Numbers of the columns of the base and of some effects."""
        return np.concatenate(
            [np.arange(self.n_base), *(np.arange(*self.place[n].indices(self.n_terms)) for n in names)]
        ).astype(np.int64)

    @property
    def n_base(self) -> int:
        """Columns of the base."""
        return self.place[self.base[-1].name].stop if self.base else 0

    def columns_of(self, names: Sequence[str], name: str) -> slice:
        """Place of an effect's sizes among those of a model of some effects; KeyError if it is none of them."""
        start = self.n_base
        for member in names:
            width = self.place[member].stop - self.place[member].start
            if member == name:
                return slice(start, start + width)
            start += width
        raise KeyError(name)

    def counted_size(self, names: Sequence[str], structure: Structure) -> float:
        """Size of the structure that speaks against some effects: beside waves alone not that of each kind of pass.

        A wave has no mean over the angle, so that it does not depend on what shifts a whole pass.
        """
        return structure.own_size if self.are_waves(names) else structure.size

    def are_waves(self, names: Sequence[str]) -> bool:
        """Whether all effects are waves, and there is one."""
        return bool(names) and all(self.place[name].stop - self.place[name].start > 1 for name in names)

    def most_likely(self, names: Sequence[str], largest_size: float = np.inf) -> Structure:
        """The structure of the largest evidence, that of no term no larger than a size: one size after the other."""
        best_structure = Structure(0.0, 0.0, SIZES[-1])
        drifts = [size for size in SIZES if size * self.unit <= self.points.drift]
        for _ in range(ROUNDS):
            former_structure = best_structure
            for name in ("closing", "drift", "own_size", "of_kind"):
                sizes = drifts if name == "drift" else SIZES
                structures = [replace(best_structure, **{name: size}) for size in sizes]
                allowed_structures = [s for s in structures if self.counted_size(names, s) <= largest_size]
                best_structure = max(allowed_structures, key=lambda structure: self.posterior(names, structure).value)
            if best_structure == former_structure:
                break
        return best_structure

    def predict_error(self, names: Sequence[str], posterior: Posterior) -> Real:
        """Errors (n,) [arcmin] by the sizes of a model, without the zeros of the intervals."""
        return np.asarray(self.columns[:, self._own_columns(names)] @ posterior.mean)

    def size_variance(self, names: Sequence[str], posterior: Posterior, is_held_out: Truth) -> Real:
        """Variance (n_held_out,) of errors about zeros by all other points, by the errors of the sizes of a model."""
        columns = self.columns[:, self._own_columns(names)]
        zeros = np.column_stack([self.zeros(column, ~is_held_out) for column in columns.T])
        about_zeros = (columns - zeros)[is_held_out]
        return np.asarray(np.einsum("nk,kl,nl->n", about_zeros, posterior.covariance, about_zeros), float)

    def zero_variance(self, variance: Real, is_chosen: Truth) -> Real:
        """Variance (n,) of each point's zero by chosen points of these variances, of which one place counts once."""
        points, size = self.points, int(self.points.zero.max()) + 1
        places = np.unique(np.column_stack([points.zero, points.place])[is_chosen], axis=0)
        count = np.bincount(places[:, 0], minlength=size)
        mean = np.bincount(points.zero[is_chosen], variance[is_chosen], size) / np.maximum(
            np.bincount(points.zero[is_chosen], minlength=size), 1
        )
        return np.where(count > 0, mean / np.maximum(count, 1), np.inf)[points.zero]

    def zeros(self, residual: Real, is_chosen: Truth) -> Real:
        """Zero (n,) of each point: weighted mean of what is left (n,) of the chosen points; NaN of none."""
        points, weight = self.points, np.where(is_chosen, 1 / self.points.noise**2, 0.0)
        size = int(points.zero.max()) + 1
        total = np.bincount(points.zero, weight, size)
        with np.errstate(invalid="ignore"):
            return (np.bincount(points.zero, weight * residual, size) / total)[points.zero]

    def unused_misfit(self, residual: Real, is_held_out: Truth, names: Sequence[str]) -> Real:
        """What is left (n_held_out,) of points about zeros by all others, beside waves about each pass's mean."""
        misfit = (residual - self.zeros(residual, ~is_held_out))[is_held_out]
        is_known, kind = np.isfinite(misfit), self.points.kind[is_held_out]
        if self.are_waves(names):  # which do not depend on what shifts a whole pass
            means = np.bincount(kind[is_known], misfit[is_known], kind.max() + 1)
            misfit -= (means / np.maximum(np.bincount(kind[is_known], minlength=len(means)), 1))[kind]
        return misfit


def _means(columns: Real, weight: Real, group: Whole, weighted_bumps: csr_array | None = None) -> tuple[Real, Real]:
    """Weighted means (n_groups, n_columns) over groups (n,) of columns (n, ...) and bumps, and weights (n_groups,)."""
    of_group = csr_array((np.ones(len(group)), (group, np.arange(len(group)))))
    total = of_group @ weight
    sums = of_group @ (weight[:, None] * columns)
    if weighted_bumps is not None:
        sums = np.hstack([sums, (of_group @ weighted_bumps).toarray()])
    return sums / total[:, None], total
