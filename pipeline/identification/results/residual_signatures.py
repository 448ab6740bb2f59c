"""What the residual of a unit depends on: each signature a number with a block-bootstrap interval.

A signature is a coefficient of a least-squares line through the residual of the cells that it is of. Blocks (position,
cycle, branch) are drawn with replacement, since neighbouring cells are not independent.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import stdtr, stdtrit  # scipy.stats is slow to import

from pipeline.arrays import Real, Truth, Whole
from pipeline.constant_kinds import Fineness, Rounding, Shown, ShownCount
from pipeline.identification.fitting.data import Data
from pipeline.identification.measurement.enough import LOADED_SHARE
from pipeline.identification.measurement.estimate import SEED
from pipeline.identification.measurement.measurement import Measurement
from pipeline.statistics.resampling import CONFIDENCE, LEVEL, resampled_means

LOW: Shown = 0.25
"""Share of the largest torque below which a cell is near zero torque."""
RESAMPLES: Fineness = 500
"""Of the block bootstrap: an end of an interval is known to a tenth of its width."""
WAVES: ShownCount = 160
"""Periods of the output angle that are looked at, even in their logarithm."""
ROUNDING: Rounding = 1e-9
"""Share of a size within which a number is zero but for rounding."""
FLIPS: Fineness = 400
"""Random signs of the blocks in a test without distribution: p is known to 1 %."""
FEWEST_BLOCKS: ShownCount = 3
"""Blocks below which a dependence has no interval."""
HARMONICS: ShownCount = 3
"""Orders of the crank angle that are looked for."""


@dataclass(frozen=True)
class Signature:
    """One dependence of the residual.

    Attributes
    ----------
    name, title : for programs and for people.
    unit : of value and interval.
    p_value : of none, each signature by itself; NaN where it is not tested.
    significant : whether p is below 5 %.
    why_not : why the data cannot test it, or give it no interval; empty if they can.
    """

    name: str
    title: str
    unit: str
    value: float = np.nan
    ci_low: float = np.nan
    ci_high: float = np.nan
    p_value: float = np.nan
    significant: bool = False
    why_not: str = ""


@dataclass(frozen=True)
class SignatureCells:
    """The cells with a residual (n,): torque [N m], sense of the torque's change, crank angle [rad], and the rest."""

    residual: Real
    torque: Real
    falling: Real
    crank: Real
    angle: Real
    cycle: Real
    hours: Real
    warmer: Real
    position: Whole
    block: Whole

    def near_zero(self) -> Truth:
        is_small: Truth = np.abs(self.torque) <= LOW * np.max(np.abs(self.torque), initial=0.0)
        return is_small

    def is_loaded(self) -> Truth:
        is_large: Truth = np.abs(self.torque) >= LOADED_SHARE * np.max(np.abs(self.torque), initial=0.0)
        return is_large


def signatures(measurement: Measurement, data: Data, predicted_angle: Real) -> tuple[Signature, ...]:
    """Signatures of the residual of predicted angles (n_cells,) [arcmin]; cells without a prediction are left out."""
    signature_cells = cells_of(measurement, data, predicted_angle)
    return (
        *_friction(signature_cells),
        *_play(signature_cells),
        _rigidity(signature_cells),
        *_over_the_crank(signature_cells, measurement.known_cranks),
        *_over_the_angle(signature_cells),
        *_over_time(signature_cells),
        _over_temperature(signature_cells),
        _shift(signature_cells, data),
        _hold(),
    )


def cells_of(measurement: Measurement, data: Data, predicted_angle: Real) -> SignatureCells:
    """The cells whose angle (n_cells,) [arcmin] is predicted, with what the prediction leaves of it."""
    cells = measurement.cells
    residual = data.angle - predicted_angle
    finite = np.isfinite(residual)
    zero = cells.angle_mean - np.array([cells.angle_mean[cells.position == p].mean() for p in cells.position])
    return SignatureCells(
        residual=residual[finite],
        torque=data.torque[finite],
        falling=-cells.direction[finite].astype(float),
        crank=np.radians(measurement.rows.cranks)[cells.position[finite]],
        angle=zero[finite],
        cycle=cells.cycle[finite].astype(float),
        hours=cells.time_mean[finite] / 3600,
        warmer=cells.temperature_mean[finite],
        position=cells.position[finite],
        block=cells.block[finite],
    )


def trend(
    cells: SignatureCells, is_selected: Truth, columns: Real, column: int, free_offset: bool = True
) -> tuple[Real, Real, int]:
    """Coefficient (1,), its resamples (RESAMPLES,), number of blocks, of column ``column`` of ``columns`` (n, k).

    Without blocks if no selected cell shows the column, as the sign of the torque where all cells are at no torque.
    """
    residual, columns = cells.residual[is_selected], columns[is_selected]
    size = np.max(np.abs(columns[:, column]), initial=0.0)
    if free_offset and len(residual):
        _, group = np.unique(cells.position[is_selected], return_inverse=True)
        group_columns = np.eye(int(group.max()) + 1)[group]
        share = group_columns / group_columns.sum(axis=0)
        residual, columns = (
            residual - group_columns @ (share.T @ residual),
            columns - group_columns @ (share.T @ columns),
        )
    if np.max(np.abs(columns[:, column]), initial=0.0) <= ROUNDING * size:
        return np.array([np.nan]), np.array([np.nan]), 0
    _, block = np.unique(cells.block[is_selected], return_inverse=True)
    n, k = int(block.max()) + 1, columns.shape[1]
    products = np.zeros((n, k, k + 1))
    np.add.at(products, block, columns[:, :, None] * np.column_stack([columns, residual])[:, None, :])
    normal_matrix = products.sum(axis=0)
    value = np.linalg.lstsq(normal_matrix[:, :k], normal_matrix[:, k], rcond=None)[0]
    resamples = n * resampled_means(products, RESAMPLES, SEED)
    ridge = ROUNDING * np.trace(normal_matrix[:, :k]) / k * np.eye(k)
    resampled_coefficients = np.linalg.solve(resamples[:, :, :k] + ridge, resamples[:, :, k][..., None])[..., 0]
    return value[column : column + 1], resampled_coefficients[:, column], n


def judged_signature(name: str, title: str, unit: str, line: tuple[Real, Real, int]) -> Signature:
    """The signature of a coefficient; few blocks widen its interval as Student's t does.

    Resampled coefficients of n blocks scatter by (n - 1)/n of the variance, as in ``fitted_numbers``.
    """
    (value,), resamples, n = line
    if n < FEWEST_BLOCKS:
        reason = f"no interval of {n} branches" if n else "no cell shows it"
        return Signature(name, title, unit, float(value), why_not=reason)
    error = float(np.std(resamples, ddof=1) * np.sqrt(n / (n - 1)))
    reach = stdtrit(n - 1, (1 + CONFIDENCE) / 2) * error
    p = float(2 * stdtr(n - 1, -abs(value) / error)) if error > 0 else float(value == 0)
    return Signature(
        name=name,
        title=title,
        unit=unit,
        value=float(value),
        ci_low=value - reach,
        ci_high=value + reach,
        p_value=p,
        significant=p < LEVEL,
    )


def signature_of(
    cells: SignatureCells,
    names: tuple[str, str, str],
    *columns: Real,
    is_selected: Truth | None = None,
    free_offset: bool = True,
) -> Signature:
    """The signature, by name, title and unit, of the first of some columns (n,), over all cells or selected ones."""
    chosen = np.ones(len(cells.residual), bool) if is_selected is None else is_selected
    return judged_signature(*names, trend(cells, chosen, np.column_stack(columns), 0, free_offset))


def not_testable(name: str, title: str, unit: str, reason: str) -> Signature:
    """A signature that the data do not hold, and why."""
    return Signature(name, title, unit, why_not=reason)


def _friction(cells: SignatureCells) -> list[Signature]:
    names = (
        ("branch_half_difference", "half-difference of the branches at no load", "arcmin"),
        ("branch_growth", "half-difference of the branches, growth with the load", "arcmin/(N m)"),
    )
    if len(np.unique(cells.falling)) < 2:
        return [not_testable(*of_column, "only one sense of the torque's change") for of_column in names]
    all_cells = np.ones(len(cells.residual), bool)
    columns = np.column_stack(
        [cells.falling, cells.falling * np.abs(cells.torque), cells.torque, np.sign(cells.torque)]
    )
    return [judged_signature(*names[column], trend(cells, all_cells, columns, column)) for column in (0, 1)]


def _play(cells: SignatureCells) -> tuple[Signature, ...]:
    side, size = np.sign(cells.torque), np.abs(cells.torque)
    play = "play", "step of the branch mean across zero torque", "arcmin"
    title = "part of the branch mean that is equal in both senses of load, per torque"
    return (
        signature_of(cells, play, 0.5 * side, cells.falling, is_selected=cells.near_zero()),
        signature_of(cells, ("asymmetry", title, "arcmin/(N m)"), size, cells.torque, side, cells.falling),
    )


def _rigidity(cells: SignatureCells) -> Signature:
    names = "compliance", "slope of the branch mean at high torque", "arcmin/(N m)"
    side = np.sign(cells.torque)
    return signature_of(cells, names, cells.torque, side, cells.falling, is_selected=cells.is_loaded())


def _over_the_crank(cells: SignatureCells, n_positions: int) -> list[Signature]:
    signatures = []
    near_zero = cells.near_zero()
    step = 0.5 * np.sign(cells.torque)
    for order in range(1, HARMONICS + 1):
        needed_positions = 2 * order + 1
        for name, wave in (("cosine", np.cos(order * cells.crank)), ("sine", np.sin(order * cells.crank))):
            names = f"crank_{order}_{name}", f"play over the crank angle, harmonic {order}, {name}", "arcmin"
            if n_positions < needed_positions:
                reason = f"needs {needed_positions} crank positions of known angle, has {n_positions}"
                signatures.append(not_testable(*names, reason))
                continue
            quadrature = np.sin(order * cells.crank) if name == "cosine" else np.cos(order * cells.crank)
            columns = step * wave, step * quadrature, step, cells.falling
            signatures.append(signature_of(cells, names, *columns, is_selected=near_zero))
    return signatures


def _over_the_angle(all_cells: SignatureCells) -> tuple[Signature, ...]:
    """Strongest period of the residual over the output angle, branch by branch less its line.

    Its p value is the share of wholly flipped blocks (signs drawn for each) whose strongest period is as strong.
    """
    names = (
        ("angle_period_amplitude", "amplitude of the strongest period over the output angle", "arcmin"),
        ("angle_period", "strongest period over the output angle", "arcmin"),
    )
    blocks, block = np.unique(all_cells.block, return_inverse=True)
    residual = all_cells.residual.copy()
    spans = []
    for number in range(len(blocks)):
        of_block = block == number
        spans.append(np.ptp(all_cells.angle[of_block]))
        torque = all_cells.torque[of_block]
        design = np.column_stack([np.ones(len(torque)), torque, torque**2, torque**3])
        residual[of_block] -= design @ np.linalg.lstsq(design, residual[of_block], rcond=None)[0]
    span, cells = float(np.median(spans)), len(residual) / len(blocks)
    if len(blocks) < FEWEST_BLOCKS or cells < 12 or span <= 0:
        return tuple(not_testable(*number, "too few cells on a branch") for number in names)
    period = np.geomspace(span / 2, 4 * span / cells, WAVES)
    turn = np.exp(2j * np.pi * all_cells.angle[:, None] / period)
    parts = np.zeros((len(blocks), WAVES), complex)
    np.add.at(parts, block, residual[:, None] * turn)
    amplitude = 2 * np.abs(parts.sum(axis=0)) / len(residual)
    strongest = int(np.argmax(amplitude))
    signs = np.random.default_rng(SEED).choice([-1.0, 1.0], (FLIPS, len(blocks)))
    flipped_amplitudes = 2 * np.abs(signs @ parts).max(axis=1) / len(residual)
    p = float((1 + np.sum(flipped_amplitudes >= amplitude[strongest])) / (1 + FLIPS))
    ends = 2 * np.abs(len(blocks) * resampled_means(parts[:, strongest], RESAMPLES, SEED)) / len(residual)
    low, high = (float(end) for end in np.percentile(ends, [2.5, 97.5]))
    strong = p < LEVEL
    return (
        Signature(*names[0], float(amplitude[strongest]), low, high, p, strong),
        Signature(*names[1], float(period[strongest]), p_value=p, significant=strong),
    )


def _over_time(cells: SignatureCells) -> list[Signature]:
    step = 0.5 * np.sign(cells.torque)
    play = "play_per_cycle", "growth of the play from cycle to cycle", "arcmin"
    shift = "shift_per_cycle", "shift of the angle from cycle to cycle", "arcmin"
    drift = "drift", "drift of the angle with time", "arcmin/h"
    if len(np.unique(cells.cycle)) < 2:
        signatures = [not_testable(*names, "fewer than 2 cycles") for names in (play, shift)]
    else:
        signatures = [
            signature_of(cells, play, step * cells.cycle, step, cells.falling, is_selected=cells.near_zero()),
            signature_of(cells, shift, cells.cycle, step, cells.falling),
        ]
    if not np.all(np.isfinite(cells.hours)) or np.ptp(cells.hours) == 0:
        return [*signatures, not_testable(*drift, "no time stamps")]
    hours = cells.hours - cells.hours.mean()
    return [*signatures, signature_of(cells, drift, hours, step, cells.falling, cells.torque)]


def _over_temperature(cells: SignatureCells) -> Signature:
    names = "play_per_kelvin", "growth of the play with the temperature", "arcmin/K"
    finite = np.isfinite(cells.warmer)
    if not finite.all() or np.ptp(cells.warmer) < 0.2:
        return not_testable(*names, "no temperature that varies")
    step = 0.5 * np.sign(cells.torque)
    warmer = cells.warmer - cells.warmer.mean()
    return signature_of(cells, names, step * warmer, step, cells.falling, is_selected=cells.near_zero())


def _shift(cells: SignatureCells, data: Data) -> Signature:
    names = "shift", "constant shift of the angle", "arcmin"
    if not data.common_offset:
        return not_testable(*names, "every position has its own zero of the angle")
    return signature_of(cells, names, np.ones(len(cells.residual)), cells.torque, free_offset=False)


def _hold() -> Signature:
    """Cells average a hold at the end of a branch with the branch: see the candidate creep, which knows the time."""
    reason = "a hold is part of the last cell of its branch; the effect creep tests it by the time of the cells"
    return not_testable("creep", "growth of the angle at constant load", "arcmin", reason)
