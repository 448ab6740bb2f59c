"""Predictions of cells by fits that have not seen them: the model as declared, refitted, and with the best effects.

Before, refitted and after come from one procedure. In each fold everything is estimated anew from the training cells
alone: calibrated numbers, tolerances, effects, and which effects. Of the cells left out nothing is used but the zero of
the angle and the phase of a ripple, where every position has its own; and which models were fitted over all cells: a
fold chooses among those, by the evidence of its training cells.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri, stdtrit

from pipeline.arrays import Real, Truth
from pipeline.identification.fitting.data import Data
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import Fit, shares_of_values
from pipeline.identification.fitting.problem import Model
from pipeline.identification.selection.covariance import parts_of
from pipeline.identification.selection.criteria import ODDS, Judge, Selection
from pipeline.identification.selection.model_selection import Selector
from pipeline.identification.selection.ripples import OwnPhases
from pipeline.identification.selection.statements.remainder import position_scatter
from pipeline.statistics.resampling import CONFIDENCE

STAGES = ("declared", "recalibrated", "after")


@dataclass(frozen=True)
class AngleError:
    """Error of predictions of held-out cells.

    Attributes
    ----------
    rms_arcmin, max_arcmin : over the cells, each counted by its rows, and the largest.
    by_crank_deg : the same rms at each held-out crank angle [deg].
    to_noise : rms of the cells, each in its own noise.
    expected_to_noise : the same that a right model would have, by its covariance: noise, and what the training cells
        leave open of tolerances, calibrated numbers and effects, and by which they scatter between positions.
    cells : their number.
    """

    rms_arcmin: float
    max_arcmin: float
    by_crank_deg: Mapping[float, float]
    to_noise: float
    expected_to_noise: float
    cells: int


@dataclass(frozen=True)
class Folds:
    """Predictions [arcmin] (n_cells,); NaN at cells that do not judge.

    Attributes
    ----------
    cells : (n_cells,) those that judge.
    declared_curve, recalibrated_curve : of the model as declared, and with its calibrated numbers refitted.
    best_curve : with the effects that were chosen, claimed or not.
    open_recalibrated, open_best : standard deviations that the training cells leave open, and by which they scatter
        from position to position.
    models : name of the model that was chosen in each fold; "" for none.
    tested_curve : of the model that is tested, which is the same in all folds: the one that is named, else the one
        without effects.
    added_squares : sum of squares, in noise, that the cells left out add to its fits (``_added_squares``).
    open_square : mean square, in noise, of what the training cells leave open of it at the cells left out, without the
        scatter between positions.
    in_sample : whether the fits have seen the cells, since nothing could be held out.
    """

    cells: Truth
    declared_curve: Real
    recalibrated_curve: Real
    best_curve: Real
    open_recalibrated: Real
    open_best: Real
    models: tuple[str, ...]
    tested_curve: Real
    added_squares: float
    open_square: float
    in_sample: bool = False

    def curves(self, is_claimed: bool) -> dict[str, tuple[Real, Real]]:
        """Prediction and its open standard deviation by stage; after is refitted where no effect is claimed."""
        refitted_curve = self.recalibrated_curve, self.open_recalibrated
        return {
            "declared": (self.declared_curve, np.zeros_like(self.declared_curve)),
            "recalibrated": refitted_curve,
            "after": (self.best_curve, self.open_best) if is_claimed else refitted_curve,
        }


def predicted_folds(selector: Selector, selection: Selection, visible: Truth) -> Folds:
    """Predictions of held-out cells.

    Parameters
    ----------
    selection : on the cells ``visible`` (n_cells,); where these are not all, the others are held out. Else whole
        positions are left out, or whole cycles of a single position (``splits_of``). One loop alone is predicted in
        sample.
    """
    fitter = selector.fitter
    data = selector.problem.data
    declared_angle = fitter.predict(Model(), fitter.start(Model())).angle
    declared_curve = np.full(len(data), np.nan)
    predicted_curves, left_open = np.full((2, 2, len(data)), np.nan)
    tested_curve = np.full(len(data), np.nan)
    models, added_squares, open_squares = [], [], []
    splits = splits_of(data, visible)
    for training, judged_cells in splits:
        if len(splits) == 1:
            fold, fits = selector, (selection.base.fit, selection.answer.fit)
        else:
            fold = selector.trained_on(training)
            fits = _fold(fold, selection, training, judged_cells)
        fitter = fold.fitter
        models.append(fits[1].model.name)
        declared_curve[judged_cells] = (
            declared_angle + fitter.offsets(declared_angle, training, fitter.problem.data.sigma)
        )[judged_cells]
        *judged_fits, tested = _in_phase(fitter, (*fits, _tested(fold, selection, training, fits)), training)
        distinct_fits = {id(fit): fit for fit in (*judged_fits, tested)}
        open_of_fit = {number: _left_open(fitter, fit, training) for number, fit in distinct_fits.items()}
        tested_curve[judged_cells] = tested.predicted_angle[judged_cells]
        added_squares.append(_added_squares(fold, selection, tested, training | judged_cells))
        open_squares.append((open_of_fit[id(tested)] / fitter.problem.data.sigma)[judged_cells] ** 2)
        for number, fit in enumerate(judged_fits):
            deviation = _prediction_deviation(fitter.problem.data, fit, training, open_of_fit[id(fit)])
            predicted_curves[number, judged_cells] = fit.predicted_angle[judged_cells]
            left_open[number, judged_cells] = deviation[judged_cells]
    cells = np.isfinite(declared_curve + predicted_curves.sum(axis=0))  # errors are compared over the same cells
    return Folds(
        cells=cells,
        declared_curve=declared_curve,
        recalibrated_curve=predicted_curves[0],
        best_curve=predicted_curves[1],
        open_recalibrated=left_open[0],
        open_best=left_open[1],
        models=tuple(models),
        tested_curve=tested_curve,
        added_squares=float(np.sum(added_squares)),
        open_square=float(np.mean(np.concatenate(open_squares))),
        in_sample=splits[0][0] is splits[0][1],
    )


def _in_phase(fitter: Fitter, fits: Sequence[Fit], training: Truth) -> list[Fit]:
    """Fits with the phases of ripples fitted at the positions left out; a fit that occurs twice is one object again."""
    with_phases = {id(fit): OwnPhases(fitter, fit, training).fitted() for fit in fits}
    return [with_phases[id(fit)] for fit in fits]


def splits_of(data: Data, visible: Truth) -> list[tuple[Truth, Truth]]:
    """Training and judged cells (n_cells,) of every fold; both are the same where nothing is held out.

    A fold leaves out a position (or a cycle of a single one), or a lot of them (``parts_of``).
    """
    if not np.all(visible):
        return [(visible, ~visible)]
    part = parts_of(data, visible)
    numbers = np.unique(part)
    if len(numbers) == 1:
        return [(visible, visible)]
    return [(part != number, part == number) for number in numbers]


def _fold(selector: Selector, selection: Selection, training: Truth, judged_cells: Truth) -> tuple[Fit, Fit]:
    """The model refitted, and with effects, from the training cells alone.

    Refitted from the declared numbers and from the fit of all cells, which only leads the search: the better fit.
    """
    fitter = selector.fitter
    from_declared = fitter.fit(Model(), training, fitter.start(Model()))
    from_all = _from_fit_of_all(selector, selection.base.fit, training, from_declared)
    base = min(from_declared, from_all, key=lambda fit: fit.cost)
    answer = selection.answer.fit
    if selection.members:
        part = int(parts_of(fitter.problem.data, training | judged_cells)[judged_cells][0])
        name = Judge(fitter, training, len(selector.testable)).chosen_without(selection, part)
        return base, _refit(selector, selection.trials[name].fit, training, base) if name else base
    return base, _from_fit_of_all(selector, answer, training, base) if answer.model.effects else base


def _refit(selector: Selector, fit_of_all: Fit, training: Truth, base: Fit) -> Fit:
    """The model of a fit of all cells, which is named, refitted to the training cells.

    From what the training cells show alone; and from the fit of all cells, which is taken where the training cells do
    not tell the two solutions apart by the odds of a class: two positions hold two phases of a second harmonic, say.
    """
    from_all = _from_fit_of_all(selector, fit_of_all, training, base)
    refit = selector.refit(fit_of_all.model, training, base, rival_cost=from_all.cost - 2 * ODDS)
    return from_all if from_all.cost <= refit.cost + 2 * ODDS else refit


def _from_fit_of_all(selector: Selector, fit_of_all: Fit, training: Truth, other: Fit) -> Fit:
    """The model of a fit of all cells, fitted to the training cells from there; ``other`` where that is not sound.

    The bounds of some parameters follow from the cells, so that the same values are other shares of them.
    """
    fitter, unknowns, model = selector.fitter, fit_of_all.unknowns, fit_of_all.model
    shares = np.clip(shares_of_values(fitter.bounds(model), fit_of_all.values.tolist()), 0.0, 1.0)
    modes = np.zeros(fitter.problem.n_modes)
    n_common = min(len(modes), len(unknowns.modes))
    modes[:n_common] = unknowns.modes[:n_common]
    start = replace(fitter.start(model, shares), scales=unknowns.scales, modes=modes)
    fit = fitter.fit(model, training, start)
    return fit if fit.sound else other


def _prediction_deviation(data: Data, fit: Fit, training: Truth, left_open: Real) -> Real:
    """Standard deviation [arcmin] (n_cells,) of what a fit cannot know of other cells, beside their noise.

    What the training cells leave open of the fit (n_cells,); and where a whole position is predicted, the scatter
    between those that were trained on, if it shows among them.
    """
    scatter = position_scatter(data, fit.predicted_angle, training)
    unseen = ~np.isin(data.position, data.position[training])
    return np.hypot(left_open, np.where(unseen, scatter.significant_size if scatter else 0.0, 0.0))


def _tested(selector: Selector, selection: Selection, training: Truth, fits: tuple[Fit, Fit]) -> Fit:
    """The fit of a fold whose model is tested: of what is named, whichever effects the training cells choose."""
    base, chosen_fit = fits
    if not selection.members:
        return base
    if chosen_fit.model.name in selection.members:
        return chosen_fit
    return _refit(selector, selection.answer.fit, training, base)


def _added_squares(selector: Selector, selection: Selection, fit: Fit, cells: Truth) -> float:
    """Sum of squares, in noise, that the cells left out add to the fit of the training cells; infinite without a fit.

    The model is fitted to all of the ``cells`` (n_cells,), from where it describes them; the sums of squares include
    the priors. Where a model is linear, the increase is the square of the error of the prediction under its whole
    covariance: noise, and what the training cells leave open. Of a right model it is chi-square with at most as many
    degrees of freedom as cells are left out. It needs no derivative, so it also holds where contacts open and close.
    """
    known_fits = [trial.fit for trial in (selection.base, *selection.trials.values())]
    start = next((known for known in known_fits if known.model.name == fit.model.name), fit)
    return max(_from_fit_of_all(selector, start, cells, replace(fit, cost=np.inf)).cost - fit.cost, 0.0)


def _left_open(fitter: Fitter, fit: Fit, training: Truth) -> Real:
    """Standard deviation [arcmin] (n_cells,) of what the training cells leave open of a fit's prediction.

    The zero of the angle is that of the training cells; a position that shares it with none of them has its own.
    """
    data = fitter.problem.data
    prediction = fitter.predict(fit.model, fit.unknowns, modes=True)
    zero = training | ~np.isin(data.group, data.group[training])
    jacobian, _ = fitter.jacobian(
        fit.model, fit.unknowns, prediction, fitter.positions, np.where(zero, 1 / data.sigma**2, 0.0), None
    )
    jacobian = OwnPhases(fitter, fit, training).removed_from(jacobian)
    covariance = np.linalg.inv(precision_of(fitter, fit, training))
    deviation: Real = np.sqrt(np.einsum("ij,jk,ik->i", jacobian, covariance, jacobian))
    return deviation


def precision_of(fitter: Fitter, fit: Fit, visible: Truth) -> Real:
    """Inverse covariance (n_unknowns, n_unknowns) of the unknowns of a fit, by the cells seen and the priors."""
    rows = fit.jacobian[visible] / fit.sigma[visible][:, None]
    precision = rows.T @ rows + np.diag(fitter.penalty(fit.unknowns) ** 2)
    regular: Real = precision + 1e-12 * np.trace(precision) * np.eye(len(precision))
    return regular


def angle_error(data: Data, cranks: Real, predicted_angle: Real, left_open: Real, cells: Truth) -> AngleError:
    """Error of a prediction (n_cells,) [arcmin] over the cells that judge; ``cranks`` by position [deg]."""
    misfit = np.where(cells, data.angle - predicted_angle, np.nan)
    is_finite = np.isfinite(misfit)
    by_crank = {
        float(crank): _rms(misfit, data, is_finite & (data.position == position))
        for position, crank in enumerate(cranks)
        if np.any(is_finite & (data.position == position))
    }
    in_noise, open_share = misfit[is_finite] / data.sigma[is_finite], left_open[is_finite] / data.sigma[is_finite]
    return AngleError(
        _rms(misfit, data, is_finite),
        float(np.max(np.abs(misfit[is_finite]), initial=0.0)),
        by_crank,
        float(np.sqrt(np.mean(in_noise**2))) if is_finite.any() else np.nan,
        float(np.sqrt(np.mean(1 + open_share**2))) if is_finite.any() else np.nan,
        int(is_finite.sum()),
    )


def _rms(misfit: Real, data: Data, is_finite: Truth) -> float:
    """Rms over cells, each counted by its rows; NaN without any."""
    return (
        float(np.sqrt(np.average(misfit[is_finite] ** 2, weights=data.count[is_finite]))) if is_finite.any() else np.nan
    )


def failed_test(data: Data, folds: Folds, baselines: Mapping[str, Real], form: float) -> str:
    """Why a refitted model is not adequate, or "": the one without effects, or the one with those that are named.

    Parameters
    ----------
    baselines : by title, predictions without a reducer (n_cells,) [arcmin] of the same cells.
    form : structure, in the noise of a cell, that the form of the model may leave.

    Notes
    -----
    Of a right model the cells left out add a sum of squares to the fit that is chi-square with one degree of freedom
    for each cell; a structure of the size of the model's form may come on top. The scatter between positions is not
    part of it: an effect of the crank angle that is missed is scatter, too. A baseline has to be ahead of a right
    model: by more than what the training cells leave open.
    """
    if folds.in_sample:
        return "nothing is held out, so the fit cannot be tested"
    n_cells = int(np.sum(folds.cells))
    if not folds.added_squares <= float(chdtri(n_cells, 1 - CONFIDENCE)) + n_cells * form**2:
        ratio = np.sqrt(folds.added_squares / n_cells)
        return f"unused data are missed by {ratio:.2g} times what a right model would leave"
    square = ((data.angle - folds.tested_curve) / data.sigma)[folds.cells] ** 2
    for title, curve in baselines.items():
        if _is_ahead(data, folds, square - folds.open_square, curve, CONFIDENCE ** (1 / len(baselines))):
            return f"{title} predicts unused data better"
    return ""


def _is_ahead(data: Data, folds: Folds, square: Real, curve: Real, level: float) -> bool:
    """Whether a prediction (n_cells,) is better than squares (n_judged,) in noise, by a t test over the branches."""
    of_curve = ((data.angle - curve) / data.sigma)[folds.cells] ** 2
    _, block = np.unique(data.block[folds.cells], return_inverse=True)
    gain = np.bincount(block, square - of_curve) / np.bincount(block)
    if len(gain) < 2 or not np.all(np.isfinite(gain)):
        return False
    error = gain.std(ddof=1) / np.sqrt(len(gain))
    return bool(gain.mean() > float(stdtrit(len(gain) - 1, level)) * error)
