"""Ovalities of measured pin circles, separated from the positions of the single pins.

A measured radial position contains the ovality of the ring, which a study has as a dimension of its own. A ring's wave
of order k has the amplitude of its Fourier coefficient. What the single pins contribute to it by chance is extrapolated
from the orders that no ovality has: an exponential correlation along the circle has the power P / (1 + (k l)^2). It is
taken off the amplitudes, and left in the positions of the pins.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.config.dimensions import dimension_library
from pipeline.config.studies.study import Study
from pipeline.decisions.lots.measured_lot import MeasuredLot

FIRST_FREE_ORDER, FREE_ORDERS = 4, 14
"""Orders beyond the ovalities from whose power the chance part is extrapolated: 4 to 17."""


def with_separate_ovalities(lot: MeasuredLot, study: Study) -> MeasuredLot:
    """The lot with ovalities taken out of the pins' radial positions, where the study varies them.

    A lot whose rings are not measured whole, or that states the ovalities itself, is returned as it is.
    """
    name = "pin_radial"
    library, values = dimension_library(), lot.values.get(name)
    orders = {
        other_name: int(other_name.rsplit("_", 1)[1])
        for other_name, dimension in library.items()
        if dimension.acts_on == name and getattr(study.tolerances, other_name).varies
    }
    if values is None or values.shape[1] < 2 * (FIRST_FREE_ORDER + FREE_ORDERS) or set(orders) & set(lot.values):
        return lot
    measured_values = {**lot.values, name: values.copy()}
    coefficients = 2 * np.fft.rfft(values, axis=1) / values.shape[1]
    free_orders = np.arange(FIRST_FREE_ORDER, FIRST_FREE_ORDER + FREE_ORDERS)
    power_of_pins = np.nanmean(np.abs(coefficients[:, free_orders]) ** 2, axis=0)
    slope, offset = np.polyfit(free_orders**2, 1 / power_of_pins, 1, w=power_of_pins)
    largest_power = float(power_of_pins.max())
    turn = 2j * np.pi * np.arange(values.shape[1]) / values.shape[1]
    for other_name, order in orders.items():
        wave = coefficients[:, order]
        inverse = offset + slope * order**2
        chance = 1 / inverse if inverse > 0 else largest_power
        size = np.abs(wave)
        amplitude = np.sqrt(np.maximum(size**2 - chance, 0.0))
        remainder = wave * (1 - np.divide(amplitude, size, out=np.zeros_like(size), where=size > 0))
        power = np.nanmean(np.abs(remainder) ** 2)
        kept_wave = remainder * np.sqrt(chance / power) if power > 0 else remainder
        measured_values[name] -= ((wave - kept_wave)[:, None] * np.exp(order * turn)).real
        measured_values[other_name] = amplitude[:, None]
    return replace(lot, values=measured_values)
