"""What can be said of a drive of which no design is known: play, friction, stiffness, and how much they leave.

Each term must help on groups of data that it was not fitted to, beside all others; one test over all terms holds the
chance of naming any that is not there at 5 %.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.fitting.cell_torques import followed_torques
from pipeline.identification.fitting.cells_in_noise import data_of
from pipeline.identification.fitting.data import Data
from pipeline.identification.generic.play_and_friction import TERMS, PlayAndFriction, TorqueCells, fit_play_and_friction
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.selection.baselines import Cycles, baselines
from pipeline.identification.selection.criteria import FEWEST_BLOCKS, REMAINING_SHARE
from pipeline.identification.selection.held_out import AngleError, angle_error, splits_of
from pipeline.identification.selection.parameter_intervals import CONFIDENCE
from pipeline.identification.selection.statements.discrepancy import Discrepancy, discrepancy
from pipeline.identification.selection.statements.verdict import UNEXPLAINED
from pipeline.statistics.blocks import max_t
from pipeline.statistics.jackknife import jackknife_interval

Real = NDArray[np.float64]
Truth = NDArray[np.bool_]

FULLY_DESCRIBED, PARTLY_DESCRIBED = "described", "partly described"
RESAMPLES, SEED = 2000, 81
"""Of the branches, for the familywise p."""
NO_STRUCTURE = float(np.hypot(1.0, REMAINING_SHARE))
"""Prediction error, in noise, that leaves nothing structured."""
LEAST_LOSS = 0.1
"""Loss, in squared noise, below which branches are alike."""
FEWEST_GROUPS = 3
"""Groups of data below which an estimate has no interval."""
STEP = 1e-3
"""Step of the derivatives, as a share of a number."""
SPRING = "compliance"
NUMBERS = {
    "play": ("play_arcmin", "arcmin", "play: angle between the two senses without torque"),
    "friction": ("friction_Nm", "N m", "constant friction, referred to the output"),
    "load_friction": ("load_friction", "1", "friction in proportion to the torque"),
    SPRING: ("compliance_arcmin_per_Nm", "arcmin/(N m)", "compliance near zero torque"),
    "softening": ("softening_arcmin_per_Nm2", "arcmin/(N m)^2", "growth of the twist with the torque squared"),
    "torque_zero": ("torque_zero_Nm", "N m", "reading of the torque without load"),
}
"""By term: attribute of the drive, unit, meaning."""


@dataclass(frozen=True)
class Number:
    """A number of the description.

    Attributes
    ----------
    term, unit, meaning : what it is.
    value, ci_low, ci_high : fitted to all training cells, with the 95 % interval of the jackknife over groups.
    p : of a term that is none, over all terms (familywise); NaN of the spring, and where nothing can be tested.
    named : whether it is claimed: not of an interval that reaches zero, or of a fit at its bound.
    note : why it has no interval; empty where it has one.
    """

    term: str
    unit: str
    meaning: str
    value: float
    ci_low: float
    ci_high: float
    p: float
    named: bool
    note: str = ""


@dataclass(frozen=True)
class Description:
    """All that is computed of a drive without a design.

    Attributes
    ----------
    verdict : described; partly described, where structure is left; unexplained, where no term is claimed.
    numbers : of all terms, fitted together.
    curves : predictions (n_cells,) [arcmin] of the cells that judge: by a spring alone, as described with all terms.
    errors : of these; ``baselines`` of predictions that ask no drive.
    cells : (n_cells,) those that judge.
    in_sample : whether nothing could be held out.
    structure : what the description leaves of the training cells beyond noise; its parameters are the numbers. None
        where nothing is left.
    """

    measurement: Measurement
    data: Data
    verdict: str
    numbers: tuple[Number, ...]
    curves: Mapping[str, Real]
    errors: Mapping[str, AngleError]
    baselines: Mapping[str, AngleError]
    cells: Truth
    in_sample: bool
    structure: Discrepancy | None


def describe(measurement: Measurement) -> Description:
    """The description of a measurement without fatal faults.

    Raises
    ------
    InputError : as ``training_rows``.
    """
    train = measurement.unit.settings.held_out.train
    training = measurement.training_cells if train else np.ones(len(measurement.cells), bool)
    data = data_of(measurement, training)
    splits = splits_of(data, training)
    numbers = _numbers(data, followed_torques(measurement), training, _term_p_values(measurement, data, splits))
    curves = {
        "spring": _predicted_angle(measurement, data, splits, frozenset()),
        "described": _predicted_angle(measurement, data, splits, frozenset(TERMS)),
    }
    cells, zeros = np.isfinite(curves["spring"]), np.zeros(len(data))
    cranks = measurement.rows.cranks
    errors = {name: angle_error(data, cranks, curve, zeros, cells) for name, curve in curves.items()}
    cycles = Cycles(measurement.cells.direction, measurement.branches.kind[measurement.cells.block])
    baseline_errors = baselines(data, cycles, splits, data.offsets)
    verdict = _verdict(errors, any(number.named for number in numbers))
    return Description(
        measurement=measurement,
        data=data,
        verdict=verdict,
        numbers=numbers,
        curves=curves,
        errors=errors,
        baselines={title: angle_error(data, cranks, curve, zeros, cells) for title, curve in baseline_errors.items()},
        cells=cells,
        in_sample=splits[0][0] is splits[0][1],
        structure=None if verdict == FULLY_DESCRIBED else _structure(measurement, data, training, numbers),
    )


def _structure(measurement: Measurement, data: Data, training: Truth, numbers: tuple[Number, ...]) -> Discrepancy:
    """Structure in what the fit to the training cells leaves of them."""
    torque, top = followed_torques(measurement), float(np.max(np.abs(data.torque)))
    values = {NUMBERS[number.term][0]: number.value for number in numbers}

    def angle(trial_values: Mapping[str, float]) -> Real:
        return PlayAndFriction(**{**values, **trial_values}).angle(torque, data.position, top)

    steps = {name: STEP * (abs(value) or 1.0) for name, value in values.items()}
    jacobian = np.column_stack(
        [
            (angle({name: values[name] + step}) - angle({name: values[name] - step})) / (2 * step)
            for name, step in steps.items()
        ]
    )
    residual, direction = data.angle - angle({}), measurement.cells.direction.astype(float)
    return discrepancy(
        data.torque[training],
        direction[training],
        data.position[training],
        residual[training],
        data.sigma[training],
        jacobian[training],
    )


def _verdict(errors: Mapping[str, AngleError], claims: bool) -> str:
    if not claims:
        return UNEXPLAINED
    return FULLY_DESCRIBED if errors["described"].to_noise <= NO_STRUCTURE else PARTLY_DESCRIBED


def _fit(data: Data, torque: Real, training: Truth, terms: frozenset[str]) -> PlayAndFriction:
    cells = TorqueCells(data.position, data.group, torque, data.angle, data.sigma, float(np.max(np.abs(data.torque))))
    return fit_play_and_friction(cells, training, terms)


def _predicted_angle(
    measurement: Measurement, data: Data, splits: list[tuple[Truth, Truth]], terms: frozenset[str]
) -> Real:
    """Angle (n_cells,) [arcmin] of judged cells by fits of their training cells, whose noise alone weighs them."""
    predicted_angle, torque, top = (
        np.full(len(data), np.nan),
        followed_torques(measurement),
        float(np.max(np.abs(data.torque))),
    )
    for training, judged_cells in splits:
        fold = data_of(measurement, training)
        angle = _fit(fold, torque, training, terms).angle(torque, data.position, top)
        predicted_angle[judged_cells] = (angle + fold.offsets(angle, training, fold.sigma))[judged_cells]
    return predicted_angle


def _term_p_values(measurement: Measurement, data: Data, splits: list[tuple[Truth, Truth]]) -> dict[str, float]:
    """Familywise p of each term that is left out of all terms, over held-out branches; NaN with too few of them."""
    scores = {}
    for name in (None, *TERMS):
        angle = _predicted_angle(measurement, data, splits, frozenset(TERMS) - {name})
        judged_cells = np.isfinite(angle)
        square = ((data.angle - angle)[judged_cells] / data.sigma[judged_cells]) ** 2
        _, block = np.unique(data.block[judged_cells], return_inverse=True)
        scores[name] = np.log(LEAST_LOSS + np.bincount(block, square) / np.bincount(block))
    if len(scores[None]) < FEWEST_BLOCKS or splits[0][0] is splits[0][1]:
        return dict.fromkeys(TERMS, float("nan"))
    gains = np.column_stack([scores[name] - scores[None] for name in TERMS])
    return dict(zip(TERMS, max_t(gains, RESAMPLES, SEED)[1].tolist(), strict=True))


def _numbers(data: Data, torque: Real, training: Truth, p_values: Mapping[str, float]) -> tuple[Number, ...]:
    """Every number, by the fit with all terms and by those without each group of the cells seen."""
    group = data.held_out_parts(training)
    left_out = [training & (group != number) for number in np.unique(group[training])]
    drive = _fit(data, torque, training, frozenset(TERMS))
    has_interval = len(left_out) >= FEWEST_GROUPS
    jackknife_fits = [_fit(data, torque, cells, frozenset(TERMS)) for cells in left_out if has_interval]
    top = float(np.max(np.abs(data.torque)))
    at_bound = frozenset().union(*(some_drive.terms_at_bound(top) for some_drive in (drive, *jackknife_fits)))
    numbers = []
    for term, (attribute, unit, meaning) in NUMBERS.items():
        value = getattr(drive, attribute)
        low, high = (
            (float("nan"), float("nan"))
            if term in at_bound
            else jackknife_interval(value, [getattr(jackknife_fit, attribute) for jackknife_fit in jackknife_fits])
        )
        p = p_values.get(term, float("nan"))
        note = "at the bound of the fit" if term in at_bound else ""
        numbers.append(
            Number(
                term=term,
                unit=unit,
                meaning=meaning,
                value=value,
                ci_low=low,
                ci_high=high,
                p=p,
                named=p < 1 - CONFIDENCE and low * high > 0,
                note=note,
            )
        )
    return tuple(numbers)
