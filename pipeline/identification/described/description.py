"""What can be said of a drive of which no design is known: play, friction, stiffness, and how much they leave.

Each term must help on groups of data that it was not fitted to, beside all others; one test over all terms holds the
chance of naming any that is not there at 5 %.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Real, Truth
from pipeline.constant_kinds import Fineness, Rounding, Seed
from pipeline.identification.fitting.cells_in_noise import data_of
from pipeline.identification.fitting.data import Data
from pipeline.identification.fitting.measured_loops import followed_torques
from pipeline.identification.fitting.problem import REMAINING_SHARE
from pipeline.identification.generic.crank_loops import CrankLoops
from pipeline.identification.generic.drive_terms import BASIC, BENCH
from pipeline.identification.generic.generic_drive import LoopModel
from pipeline.identification.generic.shared_fit import SharedFit, fitted_together
from pipeline.identification.measurement.enough import FEWEST_COMPARED
from pipeline.identification.measurement.faults.branch_faults import FEWEST_BLOCKS
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.selection.baselines import Cycles, baselines
from pipeline.identification.selection.held_out import AngleError, angle_error, splits_of
from pipeline.identification.selection.statements.discrepancy import Discrepancy, discrepancy
from pipeline.identification.selection.statements.verdict import UNEXPLAINED
from pipeline.statistics.resampling import LEVEL, jackknife_interval, max_t

FULLY_DESCRIBED, PARTLY_DESCRIBED = "described", "partly described"
RESAMPLES: Fineness = 2000
"""Of the branches, for the familywise p."""
SEED: Seed = 81
"""Of the resamples."""
NO_STRUCTURE = float(np.hypot(1.0, REMAINING_SHARE))
"""Prediction error, in noise, that leaves nothing structured."""
LEAST_LOSS = 0.1
"""Loss, in squared noise, below which branches are alike."""
STEP: Rounding = 1e-3
"""Step of the derivatives, in scales of a number."""
AT_NONE: Rounding = 1e-3
"""Number, in its scales, up to which a fit that ends at a bound has found that there is none."""
NUMBERS = {**BASIC, **BENCH}
"""Numbers of the description by name."""
NONE: Mapping[str, Mapping[str, float]] = {
    "play": {"play_arcmin": 0.0, "knee_Nm": 1.0},
    "friction": {"friction_Nm": 0.0},
    "load_friction": {"load_friction": 0.0},
    "torque_zero": {"torque_zero_Nm": 0.0},
}
"""Terms that a drive may have beside its spring, and their numbers where it has them not."""
STARTS: tuple[Mapping[str, float], ...] = ({}, {"friction_Nm": 0.01, "load_friction": 0.02, "play_arcmin": 0.05})
"""Starts of the fit, those of ``drive_terms`` but for some shares: its misfit has several minima."""


@dataclass(frozen=True)
class Number:
    """A number of the description.

    Attributes
    ----------
    name, unit, meaning : what it is; ``term`` is the one that it belongs to, or none of the spring.
    value, ci_low, ci_high : fitted to all training cells, with the 95 % interval of the jackknife over groups.
    p : of a term that is none, over all terms (familywise); NaN of the spring, and where nothing can be tested.
    named : whether it is claimed: not of an interval that reaches zero, or of a fit at its bound.
    note : why it has no interval; empty where it has one.
    """

    name: str
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
    data, fits = data_of(measurement, training), _Fits(measurement, followed_torques(measurement))
    splits = splits_of(data, training)
    final = fits.fit(training)
    curves = {
        "spring": _predicted_angle(data, splits, fits, tuple(NONE)),
        "described": _predicted_angle(data, splits, fits),
    }
    p_values = _term_p_values(data, splits, fits, curves["described"])
    numbers = _numbers(data, fits, final, training, p_values)
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
        structure=None if verdict == FULLY_DESCRIBED else _structure(measurement, data, training, final),
    )


@dataclass(frozen=True)
class _Fits:
    """Fits of a measurement's loops, at torques (n_cells, n_parts) [N m]."""

    measurement: Measurement
    torque: Real

    def fit(self, training: Truth, without: tuple[str, ...] = ()) -> SharedFit:
        """Least squares over the training cells (n_cells,), whose noise alone weighs them, without some terms."""
        data = data_of(self.measurement, training)
        weight = training / data.sigma**2
        loops = CrankLoops.standing(data.position, self.torque, data.angle, weight, data.common_offset)
        held = {name: value for term in without for name, value in NONE[term].items()}
        terms = [] if "torque_zero" in without else ["torque_zero"]
        scale = {name: NUMBERS[name].scale(loops.top, loops.span) for name in NUMBERS}
        starts = [{name: share * scale[name] for name, share in start.items()} for start in STARTS]
        return min((fitted_together([loops], terms, held, [start]) for start in starts), key=lambda fit: fit.rms)


def _structure(measurement: Measurement, data: Data, training: Truth, fit: SharedFit) -> Discrepancy:
    """Structure in what the fit to the training cells leaves of them."""
    loops = CrankLoops.standing(
        data.position, followed_torques(measurement), data.angle, training.astype(float), data.common_offset
    )
    model, values = LoopModel(loops), fit.values[0]
    columns = []
    for name in NUMBERS:
        step = STEP * NUMBERS[name].scale(loops.top, loops.span)
        ahead, behind = (model.predict_angle({**values, name: values[name] + sign * step}) for sign in (1, -1))
        columns.append((ahead - behind) / (2 * step))
    residual, direction = data.angle - fit.predicted_angles[0], measurement.cells.direction.astype(float)
    return discrepancy(
        data.torque[training],
        direction[training],
        data.position[training],
        residual[training],
        data.sigma[training],
        np.column_stack(columns)[training],
    )


def _verdict(errors: Mapping[str, AngleError], claims: bool) -> str:
    if not claims:
        return UNEXPLAINED
    return FULLY_DESCRIBED if errors["described"].to_noise <= NO_STRUCTURE else PARTLY_DESCRIBED


def _predicted_angle(data: Data, splits: list[tuple[Truth, Truth]], fits: _Fits, without: tuple[str, ...] = ()) -> Real:
    """Angle (n_cells,) [arcmin] of judged cells by fits of their training cells, without some terms."""
    predicted_angle = np.full(len(data), np.nan)
    for training, judged_cells in splits:
        predicted_angle[judged_cells] = fits.fit(training, without).predicted_angles[0][judged_cells]
    return predicted_angle


def _term_p_values(data: Data, splits: list[tuple[Truth, Truth]], fits: _Fits, described: Real) -> dict[str, float]:
    """Familywise p of each term that is left out of all terms, over held-out branches; none with too few of them.

    ``described``: angle (n_cells,) [arcmin] with all terms.
    """
    scores = {}
    for name in ("", *NONE):
        angle = _predicted_angle(data, splits, fits, (name,)) if name else described
        judged_cells = np.isfinite(angle)
        square = ((data.angle - angle)[judged_cells] / data.sigma[judged_cells]) ** 2
        _, block = np.unique(data.block[judged_cells], return_inverse=True)
        scores[name] = np.log(LEAST_LOSS + np.bincount(block, square) / np.bincount(block))
    if len(scores[""]) < FEWEST_BLOCKS or splits[0][0] is splits[0][1]:
        return {}
    gains = np.column_stack([scores[name] - scores[""] for name in NONE])
    return dict(zip(NONE, max_t(gains, RESAMPLES, SEED)[1].tolist(), strict=True))


def _numbers(
    data: Data, fits: _Fits, final: SharedFit, training: Truth, p_values: Mapping[str, float]
) -> tuple[Number, ...]:
    """Every number, by the fit with all terms and by those without each group of the cells seen."""
    group = data.held_out_parts(training)
    parts = np.unique(group[training])
    jackknife_fits = [fits.fit(training & (group != part)) for part in parts if len(parts) >= FEWEST_COMPARED]
    at_bound = frozenset().union(*(fit.at_bound for fit in (final, *jackknife_fits)))
    top = float(np.max(np.abs(data.torque)))
    numbers = []
    for name, number in NUMBERS.items():
        term = next((term for term, values in NONE.items() if next(iter(values)) == name), "")
        value, p = final.values[0][name], p_values.get(term, float("nan"))
        is_bounded = name in at_bound and abs(value) > AT_NONE * number.scale(top, float(np.ptp(data.angle)))
        low, high = jackknife_interval(value, [fit.values[0][name] for fit in jackknife_fits if not is_bounded])
        numbers.append(
            Number(
                name=name,
                term=term,
                unit=number.unit,
                meaning=number.meaning,
                value=value,
                ci_low=low,
                ci_high=high,
                p=p,
                named=p < LEVEL and low * high > 0,
                note="at the bound of the fit" if is_bounded else "",
            )
        )
    return tuple(numbers)
