"""Which effect the data ask for: screening, held-out losses of leave-one-group-out, one test over all effects tried."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.fitting import Fit, Fitter, Vector
from pipeline.identification.grids import grid
from pipeline.identification.problem import Model, candidates
from pipeline.model.cycle import ARCMIN
from pipeline.statistics.blocks import confidence_set, max_t

Real = NDArray[np.float64]
Whole = NDArray[np.int64]
Truth = NDArray[np.bool_]

SHORTLIST = 7
"""Effects that are fitted in full, the best after a few steps."""
NEAR = 1.5
"""Further ones are fitted where their misfit is within this ratio of the best."""
FAMILYWISE = 0.05
SET_LEVEL = 0.9
STRUCTURE = 1.25
"""Held-out rms in floors up to which nothing structured is left above the noise: nothing is then claimed."""
LEAST_GAIN = 0.3
"""Fall of the mean square of held-out residuals, in floors, below which a gain is of no use."""
LEAST_LOSS = 0.1
"""Loss below which blocks are alike: far under the noise floor."""
FEWEST_BLOCKS = 8
RESAMPLES = 2000
FIRST_ITERATIONS = 3
"""Steps of a fit that rank the effects before the best are fitted in full."""
HOPELESS = 3.0
"""Screened misfit in shares of the base's beyond which an effect is not fitted at all."""
FAR_FROM_DECLARED = 0.1
"""Change of the logarithm of a calibrated number beyond which effects are looked at from the declared one too."""
FOLD_ITERATIONS = 5
MOST_EFFECTS = 4
ADDITIONS = 4
"""Effects that are tried on top of the best, those that explain most of what it leaves."""
SEED = 20170


@dataclass(frozen=True)
class Trial:
    """A model fitted to a set of cells and judged on held-out groups of it.

    Attributes
    ----------
    fit : to all the cells.
    held_out : (n_cells,) [arcmin] prediction of each cell by the fold that left it out; NaN outside the cells.
    losses : (n_blocks,) mean square of the held-out residuals of each block, in sigmas.
    """

    fit: Fit
    held_out: Real
    losses: Real

    @property
    def scores(self) -> Real:
        """Logarithms of the losses (n_blocks,): a few blocks that a model misses badly do not decide a test."""
        return np.log(LEAST_LOSS + self.losses)

    @property
    def rms(self) -> float:
        """Root of the mean loss, 1 at the noise floor."""
        return float(np.sqrt(np.mean(self.losses)))


@dataclass(frozen=True)
class Selection:
    """What was tried on a set of cells.

    Attributes
    ----------
    base : calibrated numbers and tolerances alone.
    trials : by name of the model.
    screened : (share of the base's misfit) by name of every effect that could be tested.
    t, p : of the gain over the base, p adjusted over all that were tried.
    survivors : models whose gain is significant and of use, best first.
    best : name, or "" without survivors.
    members : names of the class of the best.
    """

    base: Trial
    trials: Mapping[str, Trial]
    screened: Mapping[str, float]
    t: Mapping[str, float]
    p: Mapping[str, float]
    survivors: tuple[str, ...]
    best: str
    members: tuple[str, ...]

    @property
    def chosen(self) -> Trial:
        """The best model's trial, or the base's."""
        return self.trials[self.best] if self.best else self.base


class Selector:
    """Selections on subsets of one problem's cells; predictions of the screening are made once for all of them."""

    def __init__(self, fitter: Fitter):
        self.fitter = fitter
        self.problem = fitter.problem
        self.testable = {name: effect for name, effect in candidates().items() if not self.problem.why_not(effect)}
        self._looked: dict[tuple, list[tuple[tuple[float, ...], Real]]] = {}

    def group(self, cells: Truth) -> Whole:
        """What is left out at once (n_cells,): positions if the cells have two, else cycles."""
        data = self.problem.data
        return data.position if len(np.unique(data.position[cells])) > 1 else data.cycle

    def _looks(self, name: str, base: Fit, positions: Sequence[int]) -> list[tuple[tuple[float, ...], Real]]:
        """Predictions over the grid of an effect's parameters, put beside those of ``base``."""
        key = (base.model.name, name, base.unknowns.flat.tobytes(), tuple(positions))
        if key not in self._looked:
            model = Model((*base.model.effects, self.testable[name]))
            found = []
            for point in grid(self.problem.bounds(self.testable[name])):
                shares = np.concatenate([base.unknowns.shares, point])
                angle, _, sound = self.fitter.predict(model, replace(base.unknowns, shares=shares), positions)
                if sound:
                    found.append((point, angle))
            self._looked[key] = found
        return self._looked[key]

    def screen(self, cells: Truth, base: Fit) -> dict[str, tuple[float, Vector]]:
        """Least misfit that each further effect promises, in shares of the base's, and where to start its fit.

        Looked at over the grid of its parameters, from the base and from the declared calibrated numbers; linear in
        all other unknowns.
        """
        declared = Vector(np.zeros_like(base.unknowns.scales), base.unknowns.shares, np.zeros_like(base.unknowns.modes))
        bases = [base]
        if np.max(np.abs(base.unknowns.scales), initial=0.0) > FAR_FROM_DECLARED:
            bases.append(self.fitter.fit(base.model, cells, declared, 0))
        held = {effect.name for effect in base.model.effects}
        found: dict[str, tuple[float, Vector]] = {}
        nothing = 0.0
        for start in bases:
            if not np.isfinite(start.cost):
                continue
            misfit = self._linear_misfit(cells, start)
            nothing = nothing or max(misfit(start.predicted), 1e-300)
            for name in self.testable:
                if name in held:
                    continue
                for ratio, point in self._points(name, cells, start, misfit, nothing):
                    if name not in found or ratio < found[name][0]:
                        shares = np.concatenate([start.unknowns.shares, point])
                        found[name] = ratio, replace(start.unknowns, shares=shares)
        return found

    def _points(
        self, name: str, cells: Truth, base: Fit, misfit: Callable[[Real], float], nothing: float
    ) -> list[tuple[float, tuple[float, ...]]]:
        """Misfits in shares of ``nothing`` over the grid of an effect's parameters."""
        if name == "motor_cogging":
            ratio, point = self._cogging(cells, base)
            return [(ratio * misfit(base.predicted) / nothing, point)]
        positions = np.unique(self.problem.data.position[cells]).tolist()
        return [(misfit(angle) / nothing, point) for point, angle in self._looks(name, base, positions)]

    def _linear_misfit(self, cells: Truth, base: Fit) -> Callable[[Real], float]:
        """Sum of squares left of a prediction once the base's unknowns have moved as they can, linearly."""
        data, fitter = self.problem.data, self.fitter
        weight = np.where(cells, 1 / data.sigma**2, 0.0)
        root = np.sqrt(weight[cells])
        penalty = fitter.penalty(base.unknowns)
        rows = np.vstack([base.jacobian[cells] * root[:, None], np.diag(penalty)[penalty > 0]])
        basis = np.linalg.qr(rows)[0] if rows.shape[1] else np.zeros((len(rows), 0))

        def misfit(angle: Real) -> float:
            left = fitter.centred(np.nan_to_num(data.angle - angle), weight)[cells] * root
            padded = np.concatenate([left, np.zeros(len(rows) - len(left))])
            return float(padded @ padded - np.sum((basis.T @ padded) ** 2))

        return misfit

    def _cogging(self, cells: Truth, base: Fit) -> tuple[float, tuple[float, ...]]:
        """Best period of a small ripple: its torque moves the angle by the slope of the curve."""
        data = self.problem.data
        bounds = self.problem.bounds(self.testable["motor_cogging"])
        residual = (data.angle - base.predicted)[cells] / data.sigma[cells]
        slope = self.fitter.slopes(base)[cells]
        plain, _, _ = self.fitter.predict(base.model, base.unknowns)
        best = (1.0, (0.5, 0.5, 0.5))
        for share in np.linspace(0, 1, 160):
            waves = 10 ** (bounds[2][0] + share * (bounds[2][1] - bounds[2][0]))
            turned = waves * plain[cells] / ARCMIN
            columns = -(slope / data.sigma[cells])[:, None] * np.column_stack([np.cos(turned), np.sin(turned)])
            found, *_ = np.linalg.lstsq(columns, residual, rcond=None)
            left = residual - columns @ found
            ratio = float(left @ left / (residual @ residual))
            if ratio < best[0]:
                shares = [
                    float(np.clip((value - low) / (high - low), 0.02, 0.98))
                    for value, (low, high) in zip(found, bounds[:2], strict=True)
                ]
                best = (ratio, (shares[0], shares[1], float(share)))
        return best

    def trial(self, fit: Fit, cells: Truth) -> Trial:
        """Held-out losses of a fitted model, each group of the cells left out in turn."""
        data, group = self.problem.data, self.group(cells)
        held = np.full(len(data), np.nan)
        for one in np.unique(group[cells]):
            left_out = cells & (group == one)
            fold = self.fitter.fit(fit.model, cells & ~left_out, fit.unknowns, FOLD_ITERATIONS, fit)
            held[left_out] = fold.predicted[left_out]
        return Trial(fit, held, self.block_losses(held, cells))

    def block_losses(self, predicted: Real, cells: Truth) -> Real:
        """Mean square residual of every block (n_blocks,), in sigmas."""
        data = self.problem.data
        square = ((data.angle - predicted) / data.sigma) ** 2
        square = np.where(np.isfinite(square), square, 1e6)
        blocks, index = np.unique(data.block[cells], return_inverse=True)
        return np.bincount(index, square[cells]) / np.bincount(index)

    def select(self, cells: Truth, only: Sequence[str] = ()) -> Selection:
        """Try every effect that the data can test on ``cells`` (n_cells,), or ``only`` some models by their names."""
        base_fit = self.fitter.fit(Model(), cells, self.fitter.start(Model()))
        base = self.trial(base_fit, cells)
        screened = self.screen(cells, base_fit)
        if only:
            fits = [self._joint_fit(name, cells, screened) for name in only]
        else:
            fits = self._fits(base_fit, cells, screened, SHORTLIST)
        trials = {fit.model.name: self.trial(fit, cells) for fit in fits}
        return self._judged(base, trials, {name: found[0] for name, found in screened.items()}, cells)

    def _fits(self, base: Fit, cells: Truth, screened: Mapping[str, tuple[float, Vector]], count: int) -> list[Fit]:
        """Fits of the ``count`` best additions to a base, and of those that come near: a few steps of all rank them."""
        first = []
        for name, (ratio, start) in screened.items():
            if ratio > HOPELESS:
                continue
            model = Model((*base.model.effects, self.testable[name]))
            fit = self.fitter.fit(model, cells, start, FIRST_ITERATIONS, base)
            if np.isfinite(fit.cost) and fit.sound:
                first.append(fit)
        first.sort(key=lambda fit: fit.cost)
        near = [fit for k, fit in enumerate(first[: 2 * count]) if k < count or fit.cost < NEAR * first[0].cost]
        return [self.fitter.fit(fit.model, cells, fit.unknowns, near=fit) for fit in near]

    def _joint_fit(self, name: str, cells: Truth, screened: Mapping[str, tuple[float, Vector]]) -> Fit:
        """Fit of a model by the names of its effects, from what the screening found of each."""
        parts = name.split("+")
        model = Model(tuple(self.testable[part] for part in parts))
        shares = np.concatenate([screened[part][1].shares for part in parts])
        return self.fitter.fit(model, cells, replace(screened[parts[0]][1], shares=shares))

    def extended(self, selection: Selection, cells: Truth, enough: float) -> Selection:
        """The selection with effects added to its best, one at a time, until its held-out rms is ``enough``.

        What is left by the best model is screened for every other effect; an addition stays if it gains significantly.
        """
        for _ in range(MOST_EFFECTS - 1):
            if not selection.best or selection.chosen.rms <= enough:
                break
            now = selection.chosen.fit
            fits = self._fits(now, cells, self.screen(cells, now), ADDITIONS)
            trials = {**selection.trials, **{fit.model.name: self.trial(fit, cells) for fit in fits}}
            before, selection = selection.best, self._judged(selection.base, trials, selection.screened, cells)
            if selection.best == before:
                break
        return selection

    def _judged(
        self, base: Trial, trials: Mapping[str, Trial], screened: Mapping[str, float], cells: Truth
    ) -> Selection:
        names = list(trials)
        if not names or len(base.losses) < FEWEST_BLOCKS or base.rms <= STRUCTURE:
            return Selection(base, trials, screened, {}, {}, (), "", ())
        t, p = max_t(np.column_stack([base.scores - trials[name].scores for name in names]), RESAMPLES, SEED)
        gain = np.array([base.rms**2 - trials[name].rms ** 2 for name in names])
        useful = (p <= FAMILYWISE) & (gain >= LEAST_GAIN)
        for k, name in enumerate(names):
            fit = trials[name].fit
            useful[k] = useful[k] and not self.problem.within_tolerance(fit.model, fit.values.tolist())
        scores = np.array([trials[name].scores.mean() for name in names])
        survivors = [names[k] for k in np.argsort(scores) if useful[k]]
        best = self._best(survivors, trials)
        members = self._members(best, survivors, trials, cells) if best else ()
        return Selection(
            base,
            trials,
            screened,
            dict(zip(names, t.tolist(), strict=True)),
            dict(zip(names, p.tolist(), strict=True)),
            tuple(survivors),
            best,
            members,
        )

    def _best(self, survivors: Sequence[str], trials: Mapping[str, Trial]) -> str:
        """Least held-out loss; more effects only where they gain significantly over the best with fewer."""
        best = ""
        for count in range(1, MOST_EFFECTS + 1):
            alike = [name for name in survivors if trials[name].fit.model.n_effects == count]
            if not alike:
                continue
            if best:
                gain = trials[best].scores - trials[alike[0]].scores
                _, p = max_t(gain[:, None], RESAMPLES, SEED)
                if p[0] > FAMILYWISE or trials[best].rms ** 2 - trials[alike[0]].rms ** 2 < LEAST_GAIN:
                    continue
            best = alike[0]
        return best

    def _members(
        self, best: str, survivors: Sequence[str], trials: Mapping[str, Trial], cells: Truth
    ) -> tuple[str, ...]:
        """The best and those of the confidence set whose predictions over the cells differ by less than the floor."""
        alike = [name for name in survivors if trials[name].fit.model.n_effects == trials[best].fit.model.n_effects]
        kept = confidence_set(np.column_stack([trials[name].scores for name in alike]), SET_LEVEL, RESAMPLES, SEED)
        sigma = self.problem.data.sigma
        members = []
        for name, inside in zip(alike, kept, strict=True):
            apart = (trials[name].fit.predicted - trials[best].fit.predicted)[cells] / sigma[cells]
            if name == best or (inside and np.sqrt(np.mean(apart**2)) < 1):
                members.append(name)
        return tuple(name for name in members if not _needless(name, members))


NESTED: Mapping[str, str] = {"presliding": "coulomb"}
"""Effects that become a simpler one at a limit of their parameters: not needed where that one does as well."""


def _needless(name: str, members: Sequence[str]) -> bool:
    return NESTED.get(name, "") in members
