"""Which rows may be fitted: numbers, not saturated, no jumps of the encoder, not at rest, not within the play."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from pipeline.arrays import Real, Truth
from pipeline.constant_kinds import Fineness
from pipeline.identification.measurement.branches import TURN_NOISE, BranchBlocks, monotone
from pipeline.identification.measurement.enough import FEWEST_COMPARED, FEWEST_PIECE_ROWS, UNLOADED_SHARE
from pipeline.identification.measurement.estimate import MAD_TO_STD, smallest_step
from pipeline.identification.measurement.repeated_branches import PLAY_SHARE
from pipeline.identification.measurement.rows import Rows
from pipeline.identification.measurement.unit_sections import InstrumentSection

SATURATION_RULE = (
    "left out are rows at or beyond torque_saturation_Nm; where the command goes on and the torque does not, rows "
    "whose command asks for the flat tail's torque or more; and an extreme that five rows in turn repeat exactly in a "
    "torque that scatters elsewhere"
)
TAIL_SHARE = 0.9
"""Share of the largest command beyond which the torque must rise, or it is saturated."""
FLAT_SHARE = 0.2
"""Slope of torque over command in the tail, in parts of the slope below half the command, that counts as flat."""
LOST_SHARE = 0.05
"""Share of the largest command that a saturated torque falls short by at least."""
CLIPPED_SHARE = 0.1
"""Share of the range of the torque over which an angle that repeats its extreme has reached the end of its range."""
FEWEST_STEPS = 20
"""Range of the angle in its smallest steps below which equal extremes say nothing."""
WIDEST_SPIKE: Fineness = 3
"""Rows of an outlier at most; what stays out longer may be the drive."""
SPIKE_FACTOR = 8.0
"""Robust standard deviations by which a spike stands out from both neighbours."""


def at_rest(rows: Rows, smallest_torque: float) -> Truth:
    """Rows at the start of a position before the torque differs from zero (n,): nobody knows where in the play."""
    is_at_rest = np.zeros(len(rows), bool)
    for position in range(len(rows.cranks)):
        of_position = np.flatnonzero(rows.position == position)
        is_loaded = np.abs(rows.torque[of_position]) > smallest_torque
        is_at_rest[of_position[: int(np.argmax(is_loaded)) if np.any(is_loaded) else 0]] = True
    return is_at_rest


def rows_at_no_torque(rows: Rows, usable: Truth, branches: BranchBlocks, smallest_torque: float, fewest: int) -> Truth:
    """Rows (n,) of a hold at no torque, where every place within the play is an equilibrium.

    The least friction keeps the drive on the side of the play that it came from; a model without friction puts each
    row on a side by the noise of its torque. A hold is ``fewest`` or more consecutive rows within ``smallest_torque``
    [N m] of zero, or of what the sensor reads without torque (`_readings_at_no_torque`). The torques of the rows before
    and after it differ by more than noise: a slow sweep is no hold.
    """
    is_held = np.zeros(len(rows), bool)
    readings = _readings_at_no_torque(rows, usable, branches)
    readings[np.abs(readings) <= smallest_torque] = 0.0
    for block, reading in zip(branches.rows, readings.tolist(), strict=True):
        numbers = np.flatnonzero(usable[block]) + block.start
        torque = rows.torque[numbers]
        is_step = np.concatenate([[True], np.abs(np.diff(torque)) > np.sqrt(2) * smallest_torque, [True]])
        for start, stop in _runs(np.abs(torque - reading) <= smallest_torque):
            is_held[numbers[start:stop]] = stop - start >= fewest and is_step[start] and is_step[stop]
    return is_held


def _readings_at_no_torque(rows: Rows, usable: Truth, branches: BranchBlocks) -> Real:
    """Torque (n_branches,) [N m] that is read in each branch without torque, where its rows show that; else 0.

    A sensor with a zero offset, or one that creeps, reads another torque than zero there. At no torque the drive stays
    on its side of the play, whether the torque rises or falls. If one step of the bench is at no torque, it is the last
    one before the play in both senses; if every step is loaded, the last ones of the two senses are a step apart.
    Friction may hold it there, too, but opens the loaded parts of the loop as well, and is seen in them. A branch goes
    on into the next cycle, which often begins at no torque: its first row counts for the last branch of the one before.
    """
    last, step = np.full((2, len(branches.rows)), np.nan)
    numbers = [np.flatnonzero(usable[block]) + block.start for block in branches.rows]
    goes_on = (np.diff(branches.position, append=-1) == 0) & (np.diff(branches.direction, append=0) == 0)
    for number, (of_branch, direction) in enumerate(zip(numbers, branches.direction.tolist(), strict=True)):
        if goes_on[number]:
            of_branch = np.append(of_branch, numbers[number + 1][:1])
        torque, rise = rows.torque[of_branch], direction * np.diff(rows.angle[of_branch])
        passes_zero = torque.size > 1 and torque[0] * torque[-1] < 0  # the first branch of a position does not
        if passes_zero and np.max(rise) > PLAY_SHARE * np.ptp(rows.angle[of_branch]):
            before_play = int(np.argmax(rise))
            last[number], step[number] = torque[before_play], abs(torque[before_play + 1] - torque[before_play])
    is_repeated = np.abs(last - last[:, None]) < 0.5 * np.minimum(step, step[:, None])
    is_repeated &= branches.position == branches.position[:, None]
    is_repeated &= branches.direction != branches.direction[:, None]
    readings = np.where(np.any(is_repeated, axis=1), last, 0.0)
    for number in np.flatnonzero(np.isnan(last)).tolist():  # the record may end there
        alike = (readings != 0) & (branches.position == branches.position[number])
        alike &= branches.direction == branches.direction[number]
        end = rows.torque[numbers[number][-1:]]
        if end.size and np.any(alike) and abs(end[0] - np.median(last[alike])) < 0.5 * np.median(step[alike]):
            readings[number] = end[0]
    return readings


def rows_in_play(rows: Rows, usable: Truth, branches: BranchBlocks) -> Truth:
    """Rows (n,) within the play, where the bench determines the angle, not the drive.

    A bench that turns the output at a constant speed reads many of them, at one torque. Each branch is looked at by
    itself. The play is its longest stretch with two properties: it covers more than `PLAY_SHARE` of the range of the
    angle, and the torque changes along it by less than this share of what it changes by over the same angle where the
    drive is loaded. A bench that sets the torque passes more than half of this stretch between two rows, and has no row
    within the play. The first and the last row of the stretch show at which torque the play is crossed. Where many rows
    lie between these two, they are left out as well, since each may lie within the play by up to one step of the bench.
    So are the rows beyond an end if none of them is loaded: a cycle may end within the play.
    """
    is_in_play = np.zeros(len(rows), bool)
    for block, direction in zip(branches.rows, branches.direction.tolist(), strict=True):
        numbers = np.flatnonzero(usable[block]) + block.start
        if numbers.size < FEWEST_COMPARED:
            continue
        torque, angle = monotone(rows.torque[numbers], direction), rows.angle[numbers]
        compliance = _loaded_compliance(torque, angle)
        gain = direction * (angle - compliance / PLAY_SHARE * torque)
        last = int(np.argmax(gain - np.minimum.accumulate(gain)))
        first = int(np.argmin(gain[: last + 1]))
        steps = np.abs(np.diff(angle[first : last + 1]))
        is_at_once = np.max(steps, initial=0.0) > 0.5 * np.sum(steps)
        if compliance > 0 and not is_at_once and gain[last] - gain[first] > PLAY_SHARE * np.ptp(angle):
            begin, end = first + 1, last
            is_steady = end - begin >= FEWEST_PIECE_ROWS
            if end > begin:
                is_loaded = np.abs(torque) > UNLOADED_SHARE * np.max(np.abs(torque))
                begin = begin - is_steady if np.any(is_loaded[: first + 1]) else 0
                end = end + is_steady if np.any(is_loaded[last:]) else numbers.size
            is_in_play[numbers[begin:end]] = True
    return is_in_play


def _loaded_compliance(torque: Real, angle: Real) -> float:
    """Larger slope [arcmin/(N m)] of a branch on its two loaded sides; 0 where it is loaded on none."""
    slopes = [0.0]
    for sense in (1, -1):
        is_loaded = sense * torque > UNLOADED_SHARE * np.max(np.abs(torque))
        if is_loaded.sum() >= FEWEST_COMPARED and np.ptp(torque[is_loaded]) > 0:
            slopes.append(float(np.polyfit(torque[is_loaded], angle[is_loaded], 1)[0]))
    return max(slopes)


def numeric(rows: Rows) -> Truth:
    """Whether crank angle, cycle, torque, angle and, where there is one, command of each row are numbers (n,)."""
    command = True if rows.command is None else np.isfinite(rows.command)
    return ~rows.is_misnumbered & np.isfinite(rows.torque) & np.isfinite(rows.angle) & command


def saturated_rows(rows: Rows, instrument: InstrumentSection, torque_noise: float) -> Truth:
    """Whether the torque of each row is cut off (n,), by `SATURATION_RULE`."""
    limit = instrument.torque_saturation_Nm
    cut = np.zeros(len(rows), bool) if limit is None else np.abs(rows.torque) >= limit
    good = numeric(rows)
    for position in range(len(rows.cranks)):
        of_position = np.flatnonzero(good & (rows.position == position))
        for sense in (1, -1):
            torque = sense * rows.torque[of_position]
            if rows.command is None:
                cut[of_position] |= _repeated_extreme(torque, torque_noise)
            else:
                cut[of_position] |= _flat_tail(sense * rows.command[of_position], torque, torque_noise)
    return cut


def spikes(rows: Rows, smallest_spike: float, torque_noise: float) -> Truth:
    """Whether the angle of a row, or of up to three, stands out from both neighbours, and the torque does not (n,).

    The scale of an ordinary step is robust over the run of one cycle, and at ``smallest_spike`` the angle's step and
    noise [arcmin]. A torque that goes out and back in three rows may well take the angle along: that is a turn. After
    an outlier the angle is back where it was, and stood before; a drive that overshoots was already on its way.
    """
    is_spike = np.zeros(len(rows), bool)
    good = numeric(rows)
    for *_, run in rows.runs():
        run_rows = np.flatnonzero(good[run]) + run.start
        if run_rows.size < 3:
            continue
        angle, torque = rows.angle[run_rows], rows.torque[run_rows]
        step = np.diff(angle)
        limit = SPIKE_FACTOR * max(MAD_TO_STD * np.median(np.abs(step)), smallest_spike)
        before_step = np.concatenate([[0.0], step])
        for width in range(1, min(WIDEST_SPIKE, run_rows.size - 2) + 1):
            out, back, came = step[:-width], step[width:], before_step[: -width - 1]
            height = np.minimum(np.abs(out), np.abs(back))
            left = np.abs(angle[width + 1 :] - angle[: -width - 1])
            on_its_way = came * np.sign(out)
            out_and_back = (out * back < 0) & (height > limit) & (np.maximum(left, on_its_way) < 0.5 * height)
            before, after = torque[: -width - 1], torque[width + 1 :]
            inside = sliding_window_view(torque, width + 2)[:, 1:-1].mean(axis=1)
            turn = np.abs(inside - (before + after) / 2) > np.abs(after - before) + TURN_NOISE * torque_noise
            for first in np.flatnonzero(out_and_back & ~turn):
                is_spike[run_rows[first + 1 : first + 1 + width]] = True
    return is_spike


def clipped_rows(rows: Rows, step: float) -> Truth:
    """Whether the angle of each row, read in steps [arcmin], stands at the end of its instrument's range (n,).

    It then repeats its extreme exactly while the torque goes on towards that end, and does so in half of the cycles or
    more; a drive that sticks by friction keeps its angle when the torque comes back.
    """
    is_clipped, good = np.zeros(len(rows), bool), numeric(rows)
    for position in range(len(rows.cranks)):
        of_position = np.flatnonzero(good & (rows.position == position))
        if of_position.size < FEWEST_PIECE_ROWS or np.ptp(rows.angle[of_position]) < FEWEST_STEPS * step:
            continue
        for sense in (1, -1):
            angle, torque = sense * rows.angle[of_position], sense * rows.coordinate[of_position]
            ends = [
                of_position[start:stop]
                for start, stop in _runs(angle == angle.max())
                if stop - start >= FEWEST_PIECE_ROWS
                and torque[start:stop].max() - torque[start] > CLIPPED_SHARE * np.ptp(torque)
            ]
            if 2 * len(ends) >= len(np.unique(rows.cycle[of_position])):
                is_clipped[np.concatenate(ends)] = True
    return is_clipped


def _runs(is_selected: Truth) -> list[tuple[int, int]]:
    """First and last + 1 of each run of selected rows."""
    edges = np.diff(np.concatenate([[0], is_selected.astype(int), [0]]))
    starts, stops = np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist()
    return list(zip(starts, stops, strict=True))


def _flat_tail(command: Real, torque: Real, noise: float) -> Truth:
    """Rows at or beyond the flat end of torque over command, both positive in the sense that is looked at."""
    nothing_flagged = np.zeros(len(command), bool)
    top = command.max(initial=0.0)
    lower, tail = (command > 0.1 * top) & (command < 0.5 * top), command > TAIL_SHARE * top
    if top <= 0 or lower.sum() < FEWEST_PIECE_ROWS or tail.sum() < FEWEST_PIECE_ROWS:
        return nothing_flagged
    if min(np.ptp(command[lower]), np.ptp(command[tail])) < 1e-6 * top:  # a hold, not a ramp
        return nothing_flagged
    gain, zero = np.polyfit(command[lower], torque[lower], 1)
    flat = np.polyfit(command[tail], torque[tail], 1)[0]
    level = np.median(torque[tail])
    level_drop = gain * top + zero - level
    if flat > FLAT_SHARE * gain or level_drop < max(LOST_SHARE * top, TURN_NOISE * noise):
        return nothing_flagged
    is_flat: Truth = gain * command + zero >= level  # not by the torque itself, whose noise would be cut at the level
    return is_flat


def _repeated_extreme(torque: Real, noise: float) -> Truth:
    """Rows of runs of equal largest values in a torque whose rows scatter by more than a digit elsewhere."""
    if torque.size == 0 or noise <= smallest_step(torque) / 2:
        return np.zeros(len(torque), bool)
    is_repeated = np.zeros(len(torque), bool)
    for start, stop in _runs(torque == torque.max()):
        is_repeated[start:stop] = stop - start >= FEWEST_PIECE_ROWS
    return is_repeated
