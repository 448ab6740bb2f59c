"""Folds over positions and over states; of these the others' shared numbers are held, and the state's own are fitted.

An error over the crank angle has a mean, an amplitude and a phase, so that folds over positions train on three at
least. With fewer positions in each state, several states hold the effect between them: a fold leaves a state out. The
positions were measured in the other states too; what is new is the state.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Real, Truth
from pipeline.identification.generic.crank_loops import CrankLoops
from pipeline.identification.generic.drive_terms import CRANK_EFFECTS, TERMS
from pipeline.identification.generic.shared_fit import SharedFit, fitted_together
from pipeline.identification.series.states import Series


@dataclass(frozen=True)
class Folds:
    """A model with given shared terms, fitted without each group of positions and to all.

    Attributes
    ----------
    terms : shared.
    fits : one without each group of positions, or without each state; of a single position the fit to all.
    final : to all.
    loss : (n_states, n_positions) mean square error [arcmin^2] at positions that were left out; NaN where a state has
        no such position, or trains on it.
    """

    terms: tuple[str, ...]
    fits: tuple[SharedFit, ...]
    final: SharedFit
    loss: Real

    def rms(self) -> float:
        """Root mean square error [arcmin] over all states and positions that were left out."""
        return float(np.sqrt(np.nanmean(self.loss)))


@dataclass(frozen=True)
class StateFolds(Folds):
    """A model whose shared terms come from the other states; its losses are at positions that a state is not fitted to.

    Attributes
    ----------
    reversed_loss : (n_states, n_positions) with the sign of the last term turned round, if it is an effect of the crank
        angle; else NaN.
    """

    reversed_loss: Real

    def reversed_rms(self) -> float:
        """Root mean square error [arcmin] with the sign of the effect turned round."""
        return float(np.sqrt(np.nanmean(self.reversed_loss)))


def state_folds(series: Series, terms: tuple[str, ...], base: StateFolds | None = None) -> StateFolds:
    """A model whose shared terms come from the other states; ``base``: one whose numbers it starts from."""
    count = len(series.states)
    final = fitted_together(series.loops, terms, start=base.final.values if base else ())
    loss, turned_loss = np.full((2, count, len(series.positions)), np.nan)
    fits = []
    for k, state in enumerate(series.loops):
        other_loops = [series.loops[j] for j in range(count) if j != k]
        fits.append(fitted_together(other_loops, terms, start=base.fits[k].values if base else ()))
        held, is_training = held_numbers(fits[k]), trained_cells(series, k)
        loss[k] = _unused_losses(series, k, predicted_by_others(state.some(is_training), terms, held), is_training)
        if terms and terms[-1] in CRANK_EFFECTS:
            curve = predicted_by_others(state.some(is_training), terms, reversed_numbers(held, terms[-1]))
            turned_loss[k] = _unused_losses(series, k, curve, is_training)
    return StateFolds(terms, tuple(fits), final, loss, turned_loss)


def held_numbers(fit: SharedFit) -> dict[str, float]:
    """Numbers that the states of a fit share."""
    return {name: fit.values[0][name] for name in fit.shared_names}


def reversed_numbers(held: Mapping[str, float], effect: str) -> dict[str, float]:
    """Numbers with the sign of an effect of the crank angle turned round: a control that has to be worse."""
    return {name: -value if name in TERMS[effect] else value for name, value in held.items()}


def predicted_by_others(state: CrankLoops, terms: Collection[str], held: Mapping[str, float]) -> Real:
    """Prediction (n_cells,) of a state whose shared numbers are held and whose own are fitted where it has weight."""
    return fitted_together([state], terms, held=held).predicted_angles[0]


def trained_cells(series: Series, state: int) -> Truth:
    """Cells (n_cells,) that a state's own numbers are fitted to: positions that its unit trains on, else one."""
    position = series.loops[state].position
    is_training: Truth = np.isin(position, position[series.states[state].measurement.training_cells])
    return position == position[0] if is_training.all() else is_training


def mean_squares(state: CrankLoops, curve: Real, cells: Truth) -> float:
    """Mean square error [arcmin^2] over some cells, each counted by its rows, each position less its mean error."""
    error = state.some(cells & np.isfinite(curve))
    residual = np.where(error.weight > 0, state.angle - curve, 0.0)
    return float(np.average((residual - error.zeros(residual)) ** 2, weights=error.weight))


def _unused_losses(series: Series, state: int, curve: Real, is_training: Truth) -> Real:
    """Mean square error (n_positions,) [arcmin^2] of a state at each position it was not trained on; else NaN."""
    loops, losses = series.loops[state], np.full(len(series.positions), np.nan)
    for column, name in enumerate(series.positions):
        cells = series.cells_of(name)[state] & ~is_training
        if loops.weight[cells].sum() > 0:
            losses[column] = mean_squares(loops, curve, cells)
    return losses
