"""Whether torques and angles can be in the unit that they are said to be in, and in which unit they could be."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Real
from pipeline.identification.measurement.columns import ANGLE_UNITS, TORQUE_UNITS

LARGEST_TORQUE = 20.0
"""Times the rated torque: no reducer stands more."""
SMALLEST_TORQUE = 5e-3
"""Times the rated torque: below it a cycle says nothing about the reducer; torques in kN m lie there."""
LIKELY_TORQUE = (0.05, 5.0)
"""Times the rated torque, of a bench: by which other units are suggested."""
DOUBTFUL_TORQUE = 0.05
"""Times the rated torque, below which loops may be those of the input."""
REVOLUTION = 21600.0
"""In minutes of arc; an output that turns further is not held."""
FINEST_ANGLE = 1e-2
"""Span [arcmin] below which no encoder resolves a loop."""
LIKELY_ANGLE = (0.2, 1200.0)
"""Span of a loop [arcmin], by which other units are suggested."""


def implausible_torque(torque: Real, rated_torque: float) -> str:
    """Why torques [N m] cannot be in N m, with the units that they could be in; empty if they can."""
    top = float(np.max(np.abs(torque)))
    if SMALLEST_TORQUE * rated_torque <= top <= LARGEST_TORQUE * rated_torque:
        return ""
    advice = _advice(top, TORQUE_UNITS, (LIKELY_TORQUE[0] * rated_torque, LIKELY_TORQUE[1] * rated_torque), "torque_Nm")
    return f"the largest torque is {top:.4g} N m, the rated torque {rated_torque:g} N m; {advice}"


def implausible_angle(span: float, resolution: float | None, limit: float, unit: str) -> str:
    """Why a loop of height `span` [arcmin] cannot be in arcmin, with the units that it could be in; empty if it can.

    Parameters
    ----------
    resolution : of the instrument [arcmin], None if unknown.
    limit : span [arcmin] that no reducer of the design can have.
    unit : in which the angle is said to be.
    """
    smallest_span = max(FINEST_ANGLE, resolution or 0.0)
    if smallest_span <= span <= min(REVOLUTION, limit):
        return ""
    reason = (
        f"{smallest_span:g} arcmin can be resolved"
        if span < smallest_span
        else f"a drive of this design has {limit:.3g} at most"
    )
    likely = LIKELY_ANGLE[0], min(LIKELY_ANGLE[1], limit)
    advice = _advice(span / ANGLE_UNITS[unit], ANGLE_UNITS, likely, "angle_arcmin")
    return f"the angle spans {span:.4g} arcmin, {reason}; {advice}"


def doubtful_side(top: float, span: float, rated_torque: float, ratio: float) -> str:
    """Why a loop up to ``top`` [N m] and ``span`` [arcmin] may be of the input or in another unit; empty if likely.

    Parameters
    ----------
    rated_torque : torque of the output [N m].
    ratio : input turns per turn of the output.
    """
    if top >= DOUBTFUL_TORQUE * rated_torque and span <= LIKELY_ANGLE[1]:
        return ""
    found_text = f"the loops reach {top:.3g} N m of a rated torque of {rated_torque:g} N m and span {span:.4g} arcmin"
    at_output = LIKELY_TORQUE[0] * rated_torque <= top * ratio <= LIKELY_TORQUE[1] * rated_torque
    if at_output and LIKELY_ANGLE[0] <= span / ratio <= LIKELY_ANGLE[1]:
        return f'{found_text}: if torque and angle are of the input, say side = "input" (ratio {ratio:g})'
    return f"{found_text}, which is unusual: check unit and factor in [columns]"


def _advice(value: float, units: dict[str, float], likely: tuple[float, float], quantity: str) -> str:
    """The units in which `value` would be likely; a unit may already be in use, so that the factor is said too."""
    fitting = [
        f'"{name}" (factor {scale:.6g})' for name, scale in units.items() if likely[0] <= scale * value <= likely[1]
    ]
    if not fitting:
        return f"no unit explains it: is [columns.{quantity}] the right column?"
    return f"[columns.{quantity}] unit = {' or '.join(fitting)} would be likely"
