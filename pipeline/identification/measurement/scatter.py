"""High-frequency scatter of a signal: what neighbouring rows differ by beyond a straight line."""

import numpy as np

from pipeline.arrays import Real
from pipeline.identification.measurement.rows import Rows
from pipeline.identification.measurement.unit_sections import InstrumentSection

MAD_TO_STD = 1.4826
"""Standard deviation over median absolute deviation of normal values."""


def high_frequency_scatter(values: Real, runs: list[slice]) -> float:
    """Standard deviation of independent noise in a signal sampled along `runs` of rows, in its own unit.

    Second differences remove a ramp and have the variance 6 s^2; their median absolute value ignores corners and steps.
    Noise that is alike in neighbouring rows is not seen. NaN with fewer than three rows in a run.
    """
    second = [np.diff(values[run], 2) for run in runs]
    second_differences = np.concatenate(second) if second else np.empty(0)
    second_differences = second_differences[np.isfinite(second_differences)]
    return float(MAD_TO_STD * np.median(np.abs(second_differences)) / np.sqrt(6)) if second_differences.size else np.nan


def smallest_step(values: Real) -> float:
    """The smallest difference between two different values; 0 where all are equal."""
    steps = np.diff(np.unique(values[np.isfinite(values)]))
    scale = np.nanmax(np.abs(values)) if steps.size else 0.0
    steps = steps[steps > 1e-9 * scale]  # a rounded decimal times a factor differs from itself in its last digits
    return float(steps.min()) if steps.size else 0.0


def torque_noise(rows: Rows, instrument: InstrumentSection, runs: list[slice] | None = None) -> float:
    """Standard deviation of the torque of a row [N m]: as declared, else its scatter; 0 if unknown.

    Parameters
    ----------
    runs : of rows whose scatter is taken, instead of all.
    """
    if instrument.torque_noise_Nm is not None:
        return instrument.torque_noise_Nm
    estimate = high_frequency_scatter(rows.torque, [run for *_, run in rows.runs()] if runs is None else runs)
    return estimate if np.isfinite(estimate) else 0.0
