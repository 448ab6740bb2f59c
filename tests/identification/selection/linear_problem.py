"""A linear problem whose fits are exact, for the tests of intervals and verdicts."""

from types import SimpleNamespace

import numpy as np

from pipeline.identification.fitting.data import Data
from pipeline.identification.fitting.parameters import Fit, Vector
from pipeline.model.effects.effect import CYCLES, TIME

BLOCKS, CELLS = 24, 20
BOUNDS = (-4.0, 6.0)


class LinearFitter:
    """Angle = slope x value: one number of an effect, and one calibrated number that the prior holds.

    With ``confused`` the calibrated number, ``scale`` in truth, shows mostly as so much of the first effect.
    """

    def __init__(self, truth, noise, rng, effects=1, confused=None, scale=0.0):
        n = BLOCKS * CELLS
        self.design = rng.normal(size=(n, effects + 1))
        if confused is not None:
            self.design[:, 0] = confused * self.design[:, 1] + 1e-3 * self.design[:, 0]
        block = np.repeat(np.arange(BLOCKS), CELLS)
        shared = 0.5 * noise * rng.normal(size=BLOCKS)[block]  # what the cells of a block have in common
        angle = self.design @ np.append(scale, truth) + shared + noise * rng.normal(size=n)
        torque = np.tile(np.linspace(-1, 1, CELLS), BLOCKS)
        count, whole = np.ones(n, np.int64), block // BLOCKS
        self.problem = SimpleNamespace(
            calibrated_keys=("bearing.stiffness",),
            bounds=lambda effect: (BOUNDS,) * len(effect.parameters),
            record={TIME: 3.0, CYCLES: 2.0},
            scale_range=np.array([[-2.0], [2.0]]),
            scale_spread=np.array([1.0]),
            data=Data(
                position=block % 2,
                cycle=whole,
                block=block,
                branch=block,
                torque=torque,
                angle=angle,
                count=count,
                noise=noise,
                sigma=np.full(n, noise),
                row_error=np.zeros(n),
                common_offset=False,
                torque_noise=0.0,
            ),
        )

    def bounds(self, model):
        return [BOUNDS] * model.n_parameters

    def penalty(self, sample_like):
        return np.concatenate(
            [np.ones(len(sample_like.scales)), np.zeros(len(sample_like.shares)), np.ones(len(sample_like.modes))]
        )

    def centre(self, model, sample_like):
        return np.zeros(len(sample_like.flat))

    def start(self, model):
        """The declared drive: every unknown zero."""
        return Vector(np.zeros(1), np.zeros(model.n_parameters), np.zeros(0))

    def predict(self, model, unknowns):
        return SimpleNamespace(angle=np.zeros(len(self.problem.data)))

    def offsets(self, angle, cells, sigma):
        return np.zeros(len(angle))

    def fit(self, model):
        """Least squares with the prior, as a ``Fit``."""
        data, width = self.problem.data, BOUNDS[1] - BOUNDS[0]
        k = model.n_parameters
        jacobian = self.design[:, : k + 1] * np.array([1.0, *[width] * k])
        rows = np.vstack([jacobian / data.sigma[:, None], np.eye(1, k + 1)])
        start = np.full(k, -BOUNDS[0] / width)
        right = np.append(data.angle / data.sigma, 0.0)
        result = np.linalg.lstsq(rows, right, rcond=None)[0]
        shares = np.clip(start + result[1:], 0.0, 1.0)
        predicted = jacobian @ np.append(result[:1], shares - start)
        values = BOUNDS[0] + width * shares
        vector = Vector(result[:1], shares, np.zeros(0))
        return Fit(model, vector, values, predicted, 0.0, jacobian, data.sigma, np.ones(len(data.sigma)), True)


EVERYTHING = np.ones(BLOCKS * CELLS, bool)


def fitter_at(truth, noise=0.1, seed=0, effects=1):
    return LinearFitter(truth, noise, np.random.default_rng(seed), effects)
