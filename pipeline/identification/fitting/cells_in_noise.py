"""The cells of a measurement with the noise by which they are weighted.

A cell's noise is the noise floor of the unit, and beside it what its torque is uncertain by: where the curve is steeper
than it usually is (the floor holds the noise of the torque there), and where the angle jumps through the play within
the cell. The mean angle of such a cell tells the torque at which the
play was crossed, as surely as its rows and its repeats do.
"""

from collections.abc import Iterator

import numpy as np
from scipy.special import log_ndtr, ndtr, ndtri

from pipeline.arrays import Real, Truth, Whole
from pipeline.constant_kinds import Fineness, Rounding, Unit
from pipeline.identification.fitting.data import Data, TurningData
from pipeline.identification.measurement.cells import Cells
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.repeated_branches import PLAY_SHARE
from pipeline.identification.measurement.turning.turning_measurement import TurningMeasurement
from pipeline.model.units import TURN_DEG
from pipeline.statistics.resampling import CONFIDENCE

JUMP = 2.0
"""Scatter within a cell over the usual one beyond which the angle jumped in it: through the play, or a slip."""
STEP_SCATTER: Unit = 0.27
"""Scatter of rows about their line over the height of a step among them: 0.25 for one in the middle, 0.20 to 0.29
within the middle 90 %: sqrt(d - 3 d^2) with d = s (1 - s) of a step after the share s, its own variance d less what a
line of slope 6 d takes of it."""
BETWEEN_ROWS: Unit = 12**-0.5
"""Rms of the distance of a place that is anywhere between two rows from their middle [rows]."""
PLACE: Unit = 24**-0.5
"""Rms of what half a row reaches beyond a place that is anywhere between two rows [rows]."""
PLACES: Fineness = 2000
"""Torques at which the posterior of the torque is evaluated at which the play is crossed."""
SECTORS = 8
"""Of a turn of the crank: what the model's form misses goes with the pins that carry, a quarter of the circle."""
LEAST_FLOOR: Rounding = 1e-4
"""Noise floor [arcmin] of data without any noise, below what an encoder of a bench resolves."""


def data_of(measurement: Measurement, training: Truth) -> Data:
    """The cells of a measurement with their noise, which is that of the training cells (n_cells,)."""
    if isinstance(measurement, TurningMeasurement):
        return _of_turns(measurement, training)
    blocks, cells, noise = measurement.branches, measurement.cells, measurement.noise_of(training)
    floor = max(noise.floor.value, LEAST_FLOOR)
    kinds = np.column_stack([blocks.position, blocks.kind])
    branch = np.unique(kinds, axis=0, return_inverse=True)[1].ravel()[cells.block]
    row_torque_noise = float(np.nan_to_num(noise.torque_noise_Nm))
    slope, _ = _slopes(cells, noise_between_rows(row_torque_noise))
    steeper_square = np.maximum(slope**2 - np.median(slope[training]) ** 2, 0.0)
    torque_noise = row_torque_noise / np.sqrt(cells.count)
    usual_share = np.mean(1 / cells.count[training])
    white = min(np.nan_to_num(noise.row_scatter_arcmin), floor / np.sqrt(usual_share))
    cell_variance = floor**2 + white**2 * (1 / cells.count - usual_share)
    height = jump_heights(cells, training)
    within, row_error_within = jump_errors(cells, branch, training, height)
    if cells.are_rows:
        beside, row_error_beside = side_errors(cells, training, row_torque_noise), np.zeros(len(cells))
    else:
        beside, row_error_beside = place_errors(cells, height, row_torque_noise)
    return Data(
        position=cells.position,
        cycle=cells.cycle,
        block=cells.block,
        branch=branch,
        torque=cells.torque_mean,
        angle=cells.angle_mean,
        count=cells.count,
        noise=floor,
        sigma=np.sqrt(cell_variance + steeper_square * torque_noise**2 + within**2 + beside**2),
        row_error=np.hypot(row_error_within, row_error_beside),
        common_offset=measurement.unit.settings.offset == "common",
        torque_noise=float(np.median(torque_noise)),
    )


def _of_turns(measurement: TurningMeasurement, training: Truth) -> TurningData:
    """The cells of a turning crank.

    A fault of the model's form is alike in a sector of the crank, however often it is passed in one sense at one
    torque: that is their branch.
    """
    cells, noise = measurement.cells, measurement.noise_of(training)
    floor = max(noise.floor.value, LEAST_FLOOR)
    crank = measurement.rows.cranks[cells.position]
    sector = np.floor(crank / TURN_DEG * SECTORS).astype(np.int64)
    kinds = np.column_stack([measurement.branches.kind[cells.block], sector])
    usual_share = np.mean(1 / cells.count[training])
    white = min(np.nan_to_num(noise.row_scatter_arcmin), floor / np.sqrt(usual_share))
    return TurningData(
        position=cells.position,
        cycle=cells.cycle,
        block=cells.block,
        branch=np.unique(kinds, axis=0, return_inverse=True)[1].ravel(),
        torque=cells.torque_mean,
        angle=cells.angle_mean,
        count=cells.count,
        noise=floor,
        sigma=np.sqrt(floor**2 + white**2 * (1 / cells.count - usual_share)),
        row_error=np.zeros(len(cells)),
        common_offset=True,
        torque_noise=0.0,
        part=measurement.parts,
        direction=cells.direction,
        level=measurement.level,
        crank=crank,
        per_turn=TURN_DEG / measurement.motion.width,
    )


def noise_between_rows(torque_noise: float) -> float:
    """Difference [N m] that noise of the torque of a row [N m] makes between two rows at the same torque (95 %)."""
    return float(ndtri(0.5 * (1 + CONFIDENCE)) * np.sqrt(2) * torque_noise)


def _slopes(cells: Cells, least_step: float = 0.0) -> tuple[Real, Real]:
    """Largest slope [arcmin/(N m)] and distance [N m] of each cell to its neighbours, each (n_cells,)."""
    of_links, step = _slopes_of_links(cells, least_step)
    return _larger_beside(of_links), _larger_beside(step)


def _slopes_of_links(cells: Cells, least_step: float = 0.0) -> tuple[Real, Real]:
    """Slope [arcmin/(N m)] and distance [N m] from each cell to the next, each (n_cells - 1,); 0 where not linked.

    Torques that differ by less than ``least_step`` [N m], as where a bench holds the torque, count as ``least_step``
    apart, since otherwise the slope between them would be noise divided by noise.
    """
    is_linked = _is_linked(cells, least_step)
    step = np.where(is_linked, np.abs(np.diff(cells.torque_mean)), 0.0)
    slope = np.where(is_linked, np.abs(np.diff(cells.angle_mean)) / np.maximum(step, max(least_step, 1e-9)), 0.0)
    return slope, step


def _is_linked(cells: Cells, least_step: float = 0.0) -> Truth:
    """Whether each cell and the next (n_cells - 1,) follow each other on a branch, also through the end of a cycle.

    The torque changes in the sense of the branch from one to the other, or by less than ``least_step`` [N m].
    """
    is_same_branch = (np.diff(cells.position) == 0) & (np.diff(cells.direction) == 0)
    change = np.diff(cells.torque_mean)
    return np.array(is_same_branch & ((change * cells.direction[1:] > 0) | (np.abs(change) < least_step)))


def _larger_beside(of_links: Real) -> Real:
    """Larger of what two links (n_cells - 1,) of each cell have (n_cells,)."""
    larger: Real = np.maximum(np.append(of_links, 0.0), np.append(0.0, of_links))
    return larger


def jump_heights(cells: Cells, training: Truth) -> Real:
    """Height [arcmin] (n_cells,) of the jump within each cell, by its scatter beyond the usual one; 0 without one."""
    known_spreads = cells.angle_spread[training & np.isfinite(cells.angle_spread)]
    usual_spread = np.median(known_spreads) if known_spreads.size else 0.0
    exceeding_square = np.nan_to_num(cells.angle_spread) ** 2 - (JUMP * usual_spread) ** 2
    return np.asarray(np.sqrt(np.maximum(exceeding_square, 0.0)) / STEP_SCATTER)


def jump_errors(cells: Cells, branch: Whole, training: Truth, height: Real) -> tuple[Real, Real]:
    """Errors [arcmin] (n_cells,) of the mean angle where the angle jumps within a cell; 0 where it does not.

    Two arrays: errors of each cell by itself, and errors since the place of the jump between two rows is unknown.

    Parameters
    ----------
    branch : (n_cells,) equal for cells whose branches repeat each other.
    training : (n_cells,) cells whose repeats are known.
    height : (n_cells,) of the jump within each cell [arcmin].

    Notes
    -----
    The mean tells where in the cell the angle jumped: to half a row, and as surely as the repeats of the jump scatter.
    Where a jump is no way through the play, or nothing repeats it, the scatter within the cell is its error.
    """
    scatter_within, is_through_play = height * STEP_SCATTER, height > PLAY_SHARE * _ranges(cells)
    row_errors = np.where(is_through_play, height * BETWEEN_ROWS / cells.count, 0.0)
    distance = np.array([*_repeated_jumps(cells, branch, training, np.where(is_through_play, height, 0.0))])
    if not distance.size:
        return scatter_within, row_errors
    scatter = float(np.sqrt(np.mean(distance**2) / 2))
    errors = np.minimum(height * np.hypot(0.5 / cells.count, scatter), scatter_within)
    return np.where(is_through_play, errors, scatter_within), row_errors


def _ranges(cells: Cells) -> Real:
    """Range [arcmin] (n_cells,) of the angle at the position of each cell."""
    ranges = np.zeros(len(cells))
    for position in np.unique(cells.position):
        at_position = cells.position == position
        ranges[at_position] = np.ptp(cells.angle_mean[at_position])
    return ranges


def place_errors(cells: Cells, height_within: Real, torque_noise: float) -> tuple[Real, Real]:
    """Errors [arcmin] (n_cells,) of the mean angle beside a way through the play; 0 elsewhere.

    Two arrays: errors of each cell by itself, and errors since the place of the jump between two rows is unknown.

    Parameters
    ----------
    height_within : (n_cells,) of the jump within each cell [arcmin]: its way to its neighbours is part of that.
    torque_noise : of a row [N m].

    Notes
    -----
    The play is crossed somewhere between the last row of one cell and the first row of the other, to ``PLACE`` of a row
    of each, and as many rows as the noise of the torque hides.
    Where a record ends or begins there, a jump of another branch tells the height, between two cells or within one.
    """
    height, step = jumps_between(cells, height_within, torque_noise), np.abs(np.diff(cells.torque_mean))
    jumps_within = height_within > PLAY_SHARE * _ranges(cells)
    _, width = _slopes(cells)
    errors, row_errors = np.zeros(len(cells)), np.zeros(len(cells))

    def add(height: float, is_beside: Truth, rows_per_Nm: Real | float) -> None:
        """Add the error by a jump of a height [arcmin] to the cells (n_cells,) that lie beside it."""
        row_error = height * PLACE / cells.count
        error = np.minimum(np.hypot(row_error, height * torque_noise * rows_per_Nm / cells.count), height)
        errors[is_beside] = np.maximum(errors, error)[is_beside]
        row_errors[is_beside] = np.maximum(row_errors, row_error)[is_beside]

    for number in np.flatnonzero(height):
        pair, at_position = slice(number, number + 2), cells.position == cells.position[number]
        distance = np.abs(cells.torque_mean - cells.torque_mean[pair].mean())
        row_interval = step[number] / cells.count[pair].mean()
        is_beyond = _lies_beyond(cells, cells.torque_mean[pair].mean(), row_interval)
        is_beside = at_position & (distance <= np.where(is_beyond, 1.5, 0.5) * step[number])
        is_beside[pair] = True
        add(height[number], is_beside, 1 / row_interval)
    crossed_at, row = _torques_of_jumps(cells, width), width / cells.count
    for number in np.flatnonzero(jumps_within):
        distance = np.abs(cells.torque_mean - crossed_at[number])
        is_beside = _lies_beyond(cells, crossed_at[number], row[number]) & ~jumps_within
        is_beside &= distance <= 0.5 * (width + row[number])
        is_beside &= cells.position == cells.position[number]
        add(height_within[number], is_beside, 1 / np.maximum(row, 1e-9))
    return errors, row_errors


def jumps_between(cells: Cells, height_within: Real, torque_noise: float) -> Real:
    """Height [arcmin] (n_cells - 1,) of the way through the play from each cell to the next; 0 where there is none.

    The usual slope beside a jump is taken over at least the ``noise_between_rows`` of ``torque_noise`` [N m].
    """
    slope, step = _slopes_of_links(cells)
    beside, _ = _slopes_of_links(cells, noise_between_rows(torque_noise))
    usual_slope = np.maximum(_usual_after(beside, cells), _usual_after(beside[::-1], cells)[::-1])
    smallest = PLAY_SHARE * _ranges(cells)
    jumps_within = height_within > smallest
    is_smooth = (step > 0) & (usual_slope > 0) & ~(jumps_within[:-1] | jumps_within[1:])
    height = np.where(is_smooth, (slope - usual_slope) * step, 0.0)
    return np.where(height > smallest[:-1], height, 0.0)


def _usual_after(slope: Real, cells: Cells) -> Real:
    """Slope (n_links,) of the link after each. If each cell is one row, the smaller slope of the next two links.

    A row may lie within the jump, which then takes two links.
    """
    after, second = np.append(slope[1:], 0.0), np.append(slope[2:], [0.0, 0.0])
    return np.where(cells.are_rows & (second > 0), np.minimum(after, second), after)


def side_errors(cells: Cells, training: Truth, torque_noise: float) -> Real:
    """Error [arcmin] (n_cells,) of cells of one row that noise of the torque may put on the wrong side of the play.

    Parameters
    ----------
    training : (n_cells,) cells whose jumps tell the torque at which the play is crossed.
    torque_noise : of a row [N m].

    Notes
    -----
    A row on the wrong side errs by the whole height of the jump. Its mean square error is therefore the square of the
    height times the probability of the wrong side. In one sense of the torque the play is crossed at one torque, above
    the last row before each jump and below the first row after it, but for normal noise. The posterior of this torque
    follows from all jumps of the sense, and the probability of the wrong side is the mean over it. Between the weights
    of a staircase the torque may be anywhere, yet rows at the weights are on the right side.
    """
    height, torque = jumps_between(cells, np.zeros(len(cells)), torque_noise), cells.torque_mean * cells.direction
    errors = np.zeros(len(cells))
    for sense in np.unique(cells.direction):
        is_of_sense = cells.direction == sense
        has_jump = np.append((height > 0) & is_of_sense[1:], False)
        numbers = np.flatnonzero(has_jump & training)
        if not numbers.size:
            continue
        before, after = torque[numbers], torque[numbers + 1]
        places = np.linspace(before.min(), after.max(), PLACES)
        noise = max(torque_noise, (places[-1] - places[0]) / PLACES)
        log_density = np.sum(
            log_ndtr((places - before[:, None]) / noise) + log_ndtr((after[:, None] - places) / noise), axis=0
        )
        density = np.exp(log_density - log_density.max())
        density /= density.sum()
        for position in np.unique(cells.position[has_jump]):
            at_position = cells.position == position
            chosen, jump_height = is_of_sense & at_position, np.median(height[(has_jump & at_position)[:-1]])
            wrong_side = ndtr(-np.abs(torque[chosen][:, None] - places) / noise) @ density
            errors[chosen] = jump_height * np.sqrt(wrong_side)
    return errors


def _lies_beyond(cells: Cells, torque: float, row_interval: float) -> Truth:
    """Whether a torque [N m] lies beyond the end of the branch at which a cell (n_cells,) stands, but for a row."""
    is_linked, onwards = _is_linked(cells), (torque - cells.torque_mean) * cells.direction
    is_first, is_last = ~np.append(False, is_linked), ~np.append(is_linked, False)
    return np.asarray((is_first & (onwards < row_interval)) | (is_last & (onwards > -row_interval)))


def _torques_of_jumps(cells: Cells, width: Real) -> Real:
    """Torque [N m] (n_cells,) at which the angle jumps if it does so within a cell, by its mean and its neighbours'."""
    is_linked, angle = _is_linked(cells), cells.angle_mean
    share_before = np.full(len(cells), 0.5)
    between = np.flatnonzero(is_linked[1:] & is_linked[:-1]) + 1
    change = angle[between + 1] - angle[between - 1]
    share_before[between] = np.clip((angle[between + 1] - angle[between]) / np.where(change == 0, 1.0, change), 0, 1)
    return cells.torque_mean + cells.direction * (share_before - 0.5) * width


def _repeated_jumps(cells: Cells, branch: Whole, training: Truth, height: Real) -> Iterator[float]:
    """Differences between repeats of the cells that jump, over the height of the jump, the offset of both removed."""
    for number in np.unique(branch[training & (height > 0)]):
        in_branch = training & (branch == number)
        blocks = [np.flatnonzero(in_branch & (cells.block == block)) for block in np.unique(cells.block[in_branch])]
        for block_before, second in zip(blocks[:-1], blocks[1:], strict=True):
            interval = np.abs(cells.torque_mean[second] - cells.torque_mean[block_before][:, None])
            nearest_jump = np.argmin(interval, axis=1)
            distance = cells.angle_mean[second][nearest_jump] - cells.angle_mean[block_before]
            distance -= np.median(distance)
            step = np.median(np.abs(np.diff(cells.torque_mean[block_before]))) if len(block_before) > 1 else np.inf
            is_paired = (height[block_before] > 0) & (interval.min(axis=1) < step)
            yield from (distance[is_paired] / height[block_before][is_paired]).tolist()
