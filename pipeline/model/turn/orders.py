"""The orders of a periodic error: its harmonics over whole turns of the crank."""

from dataclasses import dataclass

import numpy as np

from pipeline.model.geometry.cycloid_profile import Real


@dataclass(frozen=True)
class Orders:
    """Harmonics of ``n`` errors, sum over the orders of amplitude cos(order crank + phase).

    Attributes
    ----------
    order : (n_orders,) waves per turn of the crank, ascending, without the mean.
    amplitude : (n, n_orders) in the unit of the error.
    phase : (n, n_orders) [rad]
    """

    order: Real
    amplitude: Real
    phase: Real


def orders(error: Real, turns: int = 1) -> Orders:
    """Orders of errors (n, n_angles) at angles evenly over so many turns of the crank, from crank angle 0.

    Notes
    -----
    As many as the angles tell apart: below half of the angles a turn. Waves above fold back onto them.

    Source
    ------
    Discrete Fourier transform; Oppenheim and Schafer, Discrete-Time Signal Processing (2010), ch. 8.
    """
    n_angles = error.shape[-1]
    told_apart = (n_angles - 1) // 2
    spectrum = np.fft.rfft(error, axis=-1)[..., 1 : told_apart + 1] * (2 / n_angles)
    return Orders(np.arange(1, told_apart + 1) / turns, np.abs(spectrum), np.angle(spectrum))
