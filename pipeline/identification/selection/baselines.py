"""Predictions without a model of the reducer: replay, polynomials, play and friction; replay and orders of a turn."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Real, Truth, Whole
from pipeline.constant_kinds import Rounding
from pipeline.identification.fitting.data import Data, TurningData
from pipeline.identification.generic.crank_loops import CrankLoops
from pipeline.identification.generic.shared_fit import fitted_together
from pipeline.model.units import TURN_DEG
from pipeline.statistics.curve_scatter import dummies

HARMONICS = 6
"""Orders of the crank that a description without a reducer has."""


def replayed_turn(data: Data, cycles: "Cycles", training: Truth) -> Real:
    """The mean training angle of each cell's kind at its crank angle (n_cells,) [arcmin]; NaN where there is none.

    At an angle over the turn of the output that was not trained, that at the same angle of a turn of the crank.
    """
    crank = np.round(_turning(data).crank, 6)
    replay_angle = np.full(len(data), np.nan)
    for place in (np.round(np.mod(crank, TURN_DEG), 6), crank):
        keys = np.unique(np.column_stack([cycles.kind, place]), axis=0, return_inverse=True)[1].ravel()
        count = np.bincount(keys[training], minlength=keys.max() + 1)
        total = np.bincount(keys[training], data.angle[training], minlength=keys.max() + 1)
        is_known = count[keys] > 0
        replay_angle[is_known] = total[keys][is_known] / count[keys][is_known]
    return replay_angle


def harmonics(data: Data, cycles: "Cycles", training: Truth) -> Real:
    """Orders of the crank with play, a softening spring, Coulomb and load friction (n_cells,) [arcmin]."""
    crank, torque, sense = np.radians(_turning(data).crank), data.torque, data.senses
    places = len(np.unique(np.round(np.mod(_turning(data).crank[training], TURN_DEG), 6)))
    orders = range(1, min(HARMONICS, (places - 2) // 2) + 1)  # more would go through all intervals of a turn
    waves = [wave(order * crank) for order in orders for wave in (np.cos, np.sin)]
    springs = [np.sign(torque), torque, torque * np.abs(torque), sense, sense * np.abs(torque)]
    columns = np.column_stack([np.ones(len(data)), *waves, *springs])
    root = 1 / data.sigma[training]
    amounts = np.linalg.lstsq(columns[training] * root[:, None], data.angle[training] * root, rcond=None)[0]
    return np.asarray(columns @ amounts, float)


def _turning(data: Data) -> TurningData:
    assert isinstance(data, TurningData)
    return data


TURN_METHODS: "Mapping[str, Callable[[Data, Cycles, Truth], Real]]" = {
    "replay of the training turns": replayed_turn,
    f"{HARMONICS} orders of the crank, play, softening spring, Coulomb and load friction": harmonics,
}


Offsets = Callable[[Real, Truth, Real], Real]

EXACT: Rounding = 1e-6
"""Error in noise floors below which a prediction in sample repeats what it was made of."""
DEGREE = 5
"""Of the polynomial of a branch."""


@dataclass(frozen=True)
class Cycles:
    """Where the cells stand in their cycles: direction of the torque and kind of branch, each (n_cells,)."""

    direction: Whole
    kind: Whole


Methods = Mapping[str, Callable[[Data, Cycles, Truth], Real]]
"""Predictions (n_cells,) [arcmin] by title, from data, cycles and training cells."""


def baselines(
    data: Data, cycles: Cycles, splits: list[tuple[Truth, Truth]], offsets: Offsets, methods: Methods | None = None
) -> Mapping[str, Real]:
    """Predictions (n_cells,) [arcmin] by title, of the cells left out in each split; NaN elsewhere.

    Parameters
    ----------
    splits : training and judged cells (n_cells,) of each fold.
    offsets : as ``Fitter.offsets``. A kind of branch that was not trained is predicted as another of its sense.
    methods : by title; those of loops by default.

    Notes
    -----
    In sample the replay of a loop is that loop, and a polynomial may go through all cells of a short branch: what
    leaves no error predicts nothing and is left out.
    """
    methods = METHODS if methods is None else methods
    predictions = {title: np.full(len(data), np.nan) for title in methods}
    for training, judged_cells in splits:
        known_cycles = _with_trained_kinds(cycles, training)
        for title, method in methods.items():
            angle = method(data, known_cycles, training)
            is_known = training & np.isfinite(angle)
            predictions[title][judged_cells] = (angle + offsets(angle, is_known, data.sigma))[judged_cells]
    in_sample = any(np.any(training & judged_cells) for training, judged_cells in splits)
    exact = {
        title
        for title, angle in predictions.items()
        if in_sample and np.nanmax(np.abs(data.angle - angle) / data.sigma) < EXACT
    }
    return {title: angle for title, angle in predictions.items() if title not in exact}


def _with_trained_kinds(cycles: Cycles, training: Truth) -> Cycles:
    """The cycles with each kind that was not trained in place of a trained one of its sense."""
    kind, trained_kinds = cycles.kind.copy(), np.unique(cycles.kind[training])
    for number in np.setdiff1d(kind, trained_kinds):
        of_kind = cycles.kind == number
        same_direction = cycles.kind[training & (cycles.direction == cycles.direction[of_kind][0])]
        kind[of_kind] = same_direction[-1] if same_direction.size else number
    return Cycles(cycles.direction, kind)


def replay(data: Data, cycles: Cycles, training: Truth) -> Real:
    """The mean training branch of each cell's kind at its torque (n_cells,) [arcmin]; NaN of kinds not trained.

    Torques beyond what was trained take the branch's end.
    """
    level, replay_angle = data.angle - _offsets_of(data, cycles, training), np.full(len(data), np.nan)
    for kind in np.unique(cycles.kind):
        of_kind = cycles.kind == kind
        source = training & of_kind
        branches = [np.flatnonzero(source & (data.block == block)) for block in np.unique(data.block[source])]
        if branches:
            ordered_branches = [branch[np.argsort(data.torque[branch])] for branch in branches]
            curves = [np.interp(data.torque[of_kind], data.torque[k], level[k]) for k in ordered_branches]
            replay_angle[of_kind] = np.mean(curves, axis=0)
    return replay_angle


def polynomials(data: Data, cycles: Cycles, training: Truth) -> Real:
    """A polynomial of the torque for each kind of branch (n_cells,) [arcmin]; NaN of kinds that were not trained."""
    columns, kinds = _branch_columns(data, cycles, training)
    design = np.column_stack([columns, dummies(data.group)])
    coefficients, *_ = np.linalg.lstsq(
        design[training] * _root(data, training), _weighted_angle(data, training), rcond=None
    )
    angle = columns @ coefficients[: columns.shape[1]]
    return np.where(np.isin(cycles.kind, kinds), angle, np.nan)


def play_and_friction(data: Data, cycles: Cycles, training: Truth) -> Real:
    """Play, spring, constant friction and friction in proportion to the load (n_cells,) [arcmin]."""
    weight = training / data.sigma**2
    loops = CrankLoops.standing(data.position, data.torque[:, None], data.angle, weight, data.common_offset)
    return fitted_together([loops]).predicted_angles[0]


METHODS: Methods = {
    "replay of the training loops": replay,
    "play, spring, Coulomb and load friction": play_and_friction,
    "polynomial for each branch": polynomials,
}


def _branch_columns(data: Data, cycles: Cycles, training: Truth) -> tuple[Real, Whole]:
    """Powers of the torque by kind (n_cells, n_kinds (DEGREE + 1)), and the kinds that were trained."""
    kinds = np.unique(cycles.kind[training])
    powers = np.polynomial.chebyshev.chebvander(data.torque / np.max(np.abs(data.torque[training])), DEGREE)
    return np.hstack([powers * (cycles.kind == kind)[:, None] for kind in kinds]), kinds


def _offsets_of(data: Data, cycles: Cycles, training: Truth) -> Real:
    """Offset of each training cell's position (n_cells,) [arcmin] beside a polynomial that all positions share."""
    columns, _ = _branch_columns(data, cycles, training)
    offsets = dummies(data.group)
    design = np.column_stack([offsets, columns])
    amounts, *_ = np.linalg.lstsq(design[training] * _root(data, training), _weighted_angle(data, training), rcond=None)
    return offsets @ amounts[: offsets.shape[1]]


def _root(data: Data, training: Truth) -> Real:
    return 1 / data.sigma[training][:, None]


def _weighted_angle(data: Data, training: Truth) -> Real:
    return data.angle[training] / data.sigma[training]
