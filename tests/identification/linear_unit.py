"""A unit whose angles are linear in all unknowns, fitted as a measured one: for identities that are exact there."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from pipeline.identification.fitting.data import Data
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import SCALE_REACH, Fit, Prediction
from pipeline.identification.fitting.problem import Model, candidates

MODELS = {k: tuple(candidates()[name] for name in names) for k, names in enumerate([(), ("coulomb",), ("ovality_2",)])}


def model_of(n_parameters: int) -> Model:
    """A model with so many parameters: their names mean nothing here."""
    return Model(MODELS[n_parameters])


def linear_data(positions=2, cycles=2, branches=2, cells=10, sigma=0.1, count=4) -> Data:
    """Cells in the order position, cycle, branch; angles are zeros."""
    shape = (positions, cycles, branches, cells)
    position, cycle, branch, _ = (indice.ravel() for indice in np.indices(shape))
    n = len(position)
    return Data(
        position=position,
        cycle=cycle,
        block=(position * cycles + cycle) * branches + branch,
        branch=position * branches + branch,
        torque=np.zeros(n),
        angle=np.zeros(n),
        count=np.broadcast_to(count, n).astype(np.int64),
        noise=sigma,
        sigma=np.broadcast_to(sigma, n).astype(float),
        row_error=np.zeros(n),
        common_offset=False,
        torque_noise=0.0,
    )


class LinearFitter(Fitter):
    """Angle = design x (scales, shares, modes), of shares that a model lacks zero; parameters lie between 0 and 1."""

    def __init__(self, data: Data, design: np.ndarray, scale_spread=(), n_modes: int = 0):
        self.design, self.looks = design, 0
        self.shares = design.shape[1] - len(scale_spread) - n_modes
        modes = [np.zeros((n_modes, 1))] * len(np.unique(data.position))
        super().__init__(
            SimpleNamespace(
                data=data,
                modes=modes,
                stations=[range(k, k + 1) for k in range(len(modes))],
                n_modes=n_modes,
                scale_spread=np.array(scale_spread, float),
                scale_range=SCALE_REACH * np.array([[-1.0], [1.0]]) * np.ones(len(scale_spread)),
                bounds=lambda candidate: ((0.0, 1.0),) * len(candidate.parameters),
            )
        )

    def predict(self, model, unknowns, positions=None, modes=False):
        self.looks += 1
        data, n_modes = self.problem.data, self.problem.n_modes
        in_positions = np.isin(data.position, list(self.positions if positions is None else positions))
        lacking = np.zeros(self.shares - len(unknowns.shares))
        flat = np.concatenate([unknowns.scales, unknowns.shares, lacking, unknowns.modes])
        influence = self.design[:, self.design.shape[1] - n_modes :] if modes else np.zeros((len(data), n_modes))
        angle = np.where(in_positions, self.design @ flat, np.nan)
        nothing = np.zeros(len(data))
        return Prediction(angle, influence * in_positions[:, None], nothing, nothing, nothing + 1, nothing + 1, True)

    def drives(self, model, unknowns, positions=None):
        return {}, None

    def _change(self, model, base, moved_unknowns, prediction, positions):
        return self.predict(model, moved_unknowns, positions).angle - prediction.angle


def stood(fitter: LinearFitter, model: Model, unknowns, sigma) -> Fit:
    """The fitter's model as it stands at some unknowns, its derivatives with their means."""
    predicted = fitter.design @ unknowns.flat
    one = np.ones(len(sigma))
    return Fit(model, unknowns, unknowns.shares, predicted, 0.0, fitter.design, np.asarray(sigma), one, True)
