"""What changed between two states of a drive.

Numbers of the measured loops are compared position by position, so that what is a position's own drops out. A change
is shown where the scatter of mounting over the positions of all states does not explain it, all numbers counted.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Real
from pipeline.errors import InputError
from pipeline.identification.change.loops import State
from pipeline.identification.change.scatter import Contrast
from pipeline.identification.change.table import LoopNumber, LoopTable, loop_table
from pipeline.statistics.resampling import CONFIDENCE, LEVEL

FAMILYWISE = 0.01
"""Chance of naming any change between two states that differ by mounting alone, over all numbers of a pair.

At most 2 % is promised. Numbers of loops are not exactly normal: of 1,250 drawn pairs without a change 30 were named at
a level of 2 %, 24 at 1.5 % and 16 at 1 %.
"""
CHANGE_SHOWN, NO_CHANGE, NOT_TESTABLE = "changed", "no change shown", "not testable with these data"


@dataclass(frozen=True)
class Change:
    """A number of the loops in both states.

    Attributes
    ----------
    number : what is compared.
    before, after : means over the positions of both states, geometric of a positive number.
    mean, low, high : change, a share of a positive number, with its 95 % interval; NaN where the scatter is unknown.
    p, p_family : of no change, by itself, and all numbers of the pair counted.
    detectable : change that would be shown with a chance of 80 %, a growth of a positive number.
    scatter : standard deviation that mounting adds to a state at a position, a share of a positive number.
    """

    number: LoopNumber
    before: float
    after: float
    mean: float
    low: float
    high: float
    p: float
    p_family: float
    detectable: float
    scatter: float

    @property
    def unit(self) -> str:
        """Unit of the change: a share of a positive number."""
        return "1" if self.number.kind.positive else self.number.kind.unit

    @property
    def words(self) -> str:
        """The change in words."""
        return self.number.kind.grows if self.mean > 0 else self.number.kind.falls

    @property
    def is_shown(self) -> bool:
        """Whether mounting does not explain it, all numbers counted."""
        return self.p_family < FAMILYWISE

    @property
    def likely(self) -> bool:
        """Whether mounting does not explain it by itself."""
        return self.p < LEVEL


@dataclass(frozen=True)
class Comparison:
    """Two states of a drive, and further ones.

    Attributes
    ----------
    table : numbers of the loops of all states, the two compared ones first.
    labels : of the positions that both states have.
    changes : of all numbers.
    freedom : degrees of freedom that the scatter of mounting is known with.
    """

    table: LoopTable
    labels: tuple[str, ...]
    changes: tuple[Change, ...]
    freedom: int

    @property
    def named_changes(self) -> tuple[Change, ...]:
        """What changed, the clearest first."""
        return tuple(sorted((change for change in self.changes if change.is_shown), key=lambda change: change.p))

    @property
    def near_changes(self) -> tuple[Change, ...]:
        """Where nothing is named, the changes whose intervals by themselves do not reach zero, the clearest first."""
        if self.named_changes:
            return ()
        return tuple(sorted((change for change in self.changes if change.likely), key=lambda change: change.p))

    @property
    def verdict(self) -> str:
        """Changed, no change shown, or not testable: from single positions the scatter of mounting is not known."""
        if not self.freedom:
            return NOT_TESTABLE
        return CHANGE_SHOWN if self.named_changes else NO_CHANGE

    @property
    def clearest(self) -> Change:
        """The change with the least p; the first number where the scatter is unknown."""
        return min(self.changes, key=lambda change: np.nan_to_num(change.p, nan=1.0))


def compare_states(state_before: State, state_after: State, further: Sequence[State] = ()) -> Comparison:
    """What changed between two states of a drive.

    Parameters
    ----------
    further : other states of the drive or of drives of its make: they give the scatter of mounting with more degrees of
        freedom.

    Raises
    ------
    InputError : no position, or no size of loop, is in both states.

    Notes
    -----
    All numbers share their positions; they are counted by the largest t of them (``pipeline.statistics.differences``).
    """
    labels = _shared_labels(state_before, state_after)
    table = loop_table([state_before, state_after, *further], 2)
    weights = [-1.0, 1.0, *[0.0] * len(further)]
    contrast = table.layout.contrast(weights, table.torque_error(weights))
    levels = table.level(0, labels), table.level(1, labels)
    changes = tuple(_change(table, k, levels, contrast) for k in range(len(table.numbers)))
    return Comparison(table, labels, changes, contrast.freedom if contrast else 0)


def _change(table: LoopTable, k: int, levels: tuple[Real, Real], contrast: Contrast | None) -> Change:
    """The change of number ``k``."""
    level_before, level_after = (float(level[k]) for level in levels)
    number, scatter = table.numbers[k], float(table.layout.scatter[k])
    if contrast is None:
        mean = level_after / level_before - 1 if number.kind.positive else level_after - level_before
        return Change(number, level_before, level_after, mean, *([float("nan")] * 6))
    reach = contrast.reach(CONFIDENCE)[k]
    sizes = [contrast.mean[k], contrast.mean[k] - reach, contrast.mean[k] + reach]
    further = [contrast.detectable(FAMILYWISE)[k], scatter]
    mean, low, high, detectable, spread = (
        float(np.expm1(size)) if number.kind.positive else float(size) for size in (*sizes, *further)
    )
    p, p_family = float(contrast.p[k]), float(contrast.family.p[k])
    return Change(
        number=number,
        before=level_before,
        after=level_after,
        mean=mean,
        low=low,
        high=high,
        p=p,
        p_family=p_family,
        detectable=detectable,
        scatter=spread,
    )


def _shared_labels(state_before: State, state_after: State) -> tuple[str, ...]:
    """Positions that both states have."""
    shared_labels = tuple(label for label in state_before.labels if label in state_after.labels)
    if not shared_labels:
        found_text = " and ".join(f"{state.name} {', '.join(state.labels)}" for state in (state_before, state_after))
        raise InputError(f"no position was measured in both: {found_text}; measure the same crank angles")
    return shared_labels
