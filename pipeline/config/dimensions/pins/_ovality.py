"""A pin circle out of round: waves of the pins' radial position along the circle."""

from __future__ import annotations

import numpy as np

from pipeline.config.dimensions.dimension import Dimension, Real


def oval_shift(amplitude: Real, phase: Real, order: int, pins: int) -> Real:
    """Radial shift of the pins by a ring out of round, amplitude cos(order (theta - phase)).

    Parameters
    ----------
    amplitude : (n_samples,), in any unit of length.
    phase : (n_samples,) [rad].
    order : waves around the circle.
    pins : number of pins, clockwise from theta = 0.

    Returns
    -------
    (n_samples, pins), in the unit of the amplitude.
    """
    theta = -2 * np.pi * np.arange(pins) / pins
    return amplitude[:, None] * np.cos(order * (theta - phase[:, None]))


def ovality(order: int, lobed: str, rank: int, draw_columns: tuple[int, int]) -> Dimension:
    """The ovality of so many waves."""
    return Dimension(
        name=f"ovality_{order}",
        title=f"{lobed} ovality of pin circle",
        sign="amplitude; direction random",
        meaning=f"{lobed} ovality of the pin circle, part of radial_um",
        rank=rank,
        draw_columns=draw_columns,
        one_sided=True,
        direction="direction in which the pin circle is widest",
        acts_on="pin_radial",
        shift=lambda amplitude, phase, design: oval_shift(amplitude, phase, order, design.cycloid.pins),
    )
