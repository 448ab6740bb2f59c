"""What changed between two states of a drive.

Both are described by one model, fitted to them together: play, friction, a spring that softens. Only the difference of
the two measured curves is explained: what the model misses in both, at the same position, sense and torque, is shared
and drops out. A change is estimated at each position, and judged by positions that it was not estimated at; the scatter
from position to position holds what mounting the drive again changes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # its statistics are slow to import: they are when they are called
from numpy.typing import NDArray

from pipeline.identification.change.joint_model import JointModel
from pipeline.identification.change.kinds import KINDS, Kind
from pipeline.identification.change.pairing import Pair
from pipeline.identification.change.scatter import scatter
from pipeline.identification.selection.parameter_intervals import FORM
from pipeline.statistics.rotations import Family

Real = NDArray[np.float64]

CONFIDENCE = 0.95
"""Of the intervals of what changed, each by itself."""
FAMILYWISE = 0.02
"""Chance of naming any change between two states that differ by mounting alone, over all tests of a pair."""
USEFUL = 0.9
"""Held-out error, in that of no change, above which a change is of no use."""
TRIED = 2 * len(KINDS)
"""Tests of a pair: each kind with all others equal, and with all others free."""
FEWEST_POSITIONS = 3
"""Positions below which the scatter of remounting is not known."""
EQUAL, FREE = "equal", "free"
CHANGED, NOTHING = "changed", "no change shown"


@dataclass(frozen=True)
class Change:
    """A change, or several, as all positions see it.

    Attributes
    ----------
    kinds : what changes.
    by_position : (n_positions, n_kinds)
    mean, low, high : (n_kinds,) with the 95 % interval of the scatter over positions and of the model's form; NaN with
        too few positions.
    p : (n_kinds,) of no change, each kind by itself.
    p_family : (n_kinds,) of no change, all tests of the pair counted.
    detectable : (n_kinds,) size that would have been sure with a chance of 95 %; NaN with too few positions.
    freedom : degrees of freedom that the scatter is known with; 0 with too few positions.
    mounting, held_out : at each position what is put into the drive: nothing, and the mean change of the others; with
        what mounting may have changed beside it, fitted there.
    models : of the positions.
    other_kinds : whether all other kinds are "equal" in both states, or "free" at each position.
    """

    kinds: tuple[Kind, ...]
    by_position: Real
    mean: Real
    low: Real
    high: Real
    p: Real
    p_family: Real
    detectable: Real
    freedom: int
    mounting: tuple[Mapping[Kind, float], ...]
    held_out: tuple[Mapping[Kind, float], ...]
    models: Sequence[JointModel]
    other_kinds: str

    @cached_property
    def nothing(self) -> Real:
        """Rms (n_positions,) in noise of what is left without the change."""
        return np.array([model.error(step) for model, step in zip(self.models, self.mounting, strict=True)])

    @cached_property
    def error(self) -> Real:
        """The same with the change that the other positions say."""
        return np.array([model.error(step) for model, step in zip(self.models, self.held_out, strict=True)])

    @property
    def gain(self) -> float:
        """Held-out rms of all positions, in that without the change."""
        return _rms(self.error) / _rms(self.nothing)

    @property
    def useful(self) -> bool:
        """Whether what it says of positions that it has not seen is better than no change."""
        return self.gain <= USEFUL

    @property
    def sure(self) -> bool:
        """Whether it is none of mounting, all tests of a pair counted."""
        return bool(np.all(self.p_family < FAMILYWISE))

    @property
    def likely(self) -> bool:
        """Whether the scatter over the positions, by itself, does not explain it."""
        return bool(np.all(self.p < 1 - CONFIDENCE))

    @property
    def words(self) -> str:
        """What is said of it."""
        return " and ".join(kind.grows if m > 0 else kind.falls for kind, m in zip(self.kinds, self.mean, strict=True))


def judged(
    models: Sequence[JointModel],
    kinds: tuple[Kind, ...],
    table: Real,
    family: Family | None,
    numbers: Sequence[int],
    mounted: tuple[Kind, ...] = (),
) -> Change:
    """A change of some kinds over all positions.

    Parameters
    ----------
    table : (n_states - 1, n_positions, n_kinds) changes from the first state, those of the second state first.
    family : all tests of the pair; None with too few positions.
    numbers : (n_kinds,) of the tests of these kinds.
    mounted : kinds that are fitted to each position beside it.
    """
    estimates = table[0]
    n, mean = len(models), estimates.mean(axis=0)
    low = high = p = p_family = detectable = np.full(len(kinds), np.nan)
    freedom = 0
    if family is not None:
        spread = scatter(estimates, table[1:])
        freedom, quantile = spread.freedom, 0.5 + CONFIDENCE / 2
        reach = np.hypot(
            scipy.stats.t.ppf(quantile, freedom) * spread.error, scipy.stats.norm.ppf(quantile) * FORM * np.abs(mean)
        )
        low, high, p, p_family = mean - reach, mean + reach, spread.p(mean), family.p[numbers]
        detectable = spread.detectable(family.level(FAMILYWISE))
    error_without, held_out = [], []
    for model, single in zip(models, estimates, strict=True):
        rest_of_set = (estimates.sum(axis=0) - single) / (n - 1) if n > 1 else single
        error_without.append(model.mounted(mounted, {}))
        held_out.append(model.mounted(mounted, dict(zip(kinds, rest_of_set.tolist(), strict=True))))
    return Change(
        *(kinds, estimates, mean, low, high, p, p_family, detectable, freedom, tuple(error_without), tuple(held_out)),
        *(models, FREE if mounted else EQUAL),
    )


@dataclass(frozen=True)
class _States:
    """Positions of the second state and of further ones, each held against the first."""

    models: tuple[JointModel, ...]
    further: tuple[tuple[JointModel, ...], ...]

    @cached_property
    def equal(self) -> Real:
        """Changes (n_states - 1, n_positions, n_kinds) from the first state, each kind alone."""
        return np.concatenate([self._estimates((kind,)) for kind in KINDS], axis=2)

    @cached_property
    def free(self) -> Real:
        """The same, all kinds together."""
        return self._estimates(KINDS)

    @cached_property
    def family(self) -> Family | None:
        """All tests of the pair, of kinds alone and of kinds together; None with too few positions."""
        if len(self.models) < FEWEST_POSITIONS:
            return None
        table = np.concatenate([self.equal, self.free], axis=2)
        return scatter(table[0], table[1:]).family(table[0].mean(axis=0))

    def alone(self) -> tuple[Change, ...]:
        """Each kind of change, all others equal in both states."""
        return tuple(
            judged(self.models, (kind,), self.equal[:, :, [k]], self.family, [k]) for k, kind in enumerate(KINDS)
        )

    def beside_mounting(self) -> tuple[Change, ...]:
        """Each kind of change, all others as mounting makes them differ."""
        return tuple(self._together((kind,)) for kind in KINDS)

    def joined(self, changes: Sequence[Change]) -> tuple[Change, ...]:
        """Changes as one, all kinds beside them as mounting makes them differ; nothing of none."""
        if len(changes) < 2:
            return tuple(changes)
        return (self._together(tuple(kind for change in changes for kind in change.kinds)),)

    def _together(self, kinds: tuple[Kind, ...]) -> Change:
        """A change of some kinds, all others as mounting makes them differ."""
        other_kinds = tuple(kind for kind in KINDS if kind not in kinds)
        columns = [KINDS.index(kind) for kind in kinds]
        numbers = [len(KINDS) + k for k in columns]
        return judged(self.models, kinds, self.free[:, :, columns], self.family, numbers, other_kinds)

    def _estimates(self, kinds: tuple[Kind, ...]) -> Real:
        """Changes (n_states - 1, n_positions, n_kinds) from the first state of these kinds, fitted together."""
        tables = []
        for models in (self.models, *self.further):
            by_kind = [model.estimated(kinds) for model in models]
            tables.append([[changes[kind] for kind in kinds] for changes in by_kind])
        return np.array(tables)


@dataclass(frozen=True)
class Comparison:
    """What is said of two states.

    Attributes
    ----------
    models : of each position.
    singles : every kind of change alone, all others equal in both states.
    beside : every kind, all others as mounting makes them differ; nothing with too few positions.
    named : what changed, the best description first; several where it is one of them.
    near : where nothing is named, the changes whose intervals by themselves do not reach zero, the best first.
    verdict : changed, no change shown.
    nothing : rms in noise of the difference at each position (n_positions,).
    """

    models: tuple[JointModel, ...]
    singles: tuple[Change, ...]
    beside: tuple[Change, ...]
    named: tuple[Change, ...]
    near: tuple[Change, ...]
    verdict: str
    nothing: Real

    @property
    def best(self) -> Change:
        """What is named, or nearest to it, else the single change that says most of positions that it has not seen."""
        return (
            (self.named or self.near)[0]
            if self.named or self.near
            else min(self.singles, key=lambda change: change.gain)
        )


def compared(pairs: Sequence[Pair], further: Sequence[Sequence[Pair]] = ()) -> Comparison:
    """What changed between the states of some positions.

    Parameters
    ----------
    further : of other states of the drive, the same positions held against the first state: they tell the scatter of
        mounting with more degrees of freedom.

    Notes
    -----
    All kinds are fitted to each position together, since mounting scatters each: those are named that the scatter does
    not explain, all tests counted (by the largest t of them), and that help where the others are free to differ. Where
    these loops do not part the kinds none does; then each is tried alone, and every one that is sure, all tests
    counted, is named, unless the best is better over the positions. A change that is likely by itself alone is told and
    not named: of eight tests at 5 % each one in seven pairs without a change has such a one.
    """
    states = _States(
        tuple(JointModel.of(pair) for pair in pairs),
        tuple(tuple(JointModel.of(pair) for pair in state_pairs) for state_pairs in further),
    )
    models = states.models
    singles = states.alone()
    base_errors = np.array([model.error({}) for model in models])
    if len(models) < FEWEST_POSITIONS:
        return Comparison(models, singles, (), (), (), NOTHING, base_errors)
    mounting_errors = states.beside_mounting()
    parted = [change for change in mounting_errors if change.useful and change.sure]
    likely = states.joined([change for change in mounting_errors if change.useful and change.likely])
    likely = likely or _best_of([change for change in singles if change.useful and change.likely])
    named_changes = states.joined(parted) or _best_of([change for change in singles if change.useful and change.sure])
    nearest = () if named_changes else likely
    return Comparison(
        models, singles, mounting_errors, named_changes, nearest, CHANGED if named_changes else NOTHING, base_errors
    )


def _best_of(changes: Sequence[Change]) -> tuple[Change, ...]:
    """Single changes, the best first, without those that it is better than."""
    ranked = sorted(changes, key=lambda change: change.gain)
    return tuple(change for change in ranked if not _behind(change, ranked[0]))


def _behind(change: Change, best: Change) -> bool:
    """Whether the held-out errors of a change are larger than those of the best, all tests counted."""
    gap = change.error**2 - best.error**2
    spread = max(float(gap.std(ddof=1)) / np.sqrt(len(gap)), 1e-12)
    return bool(gap.mean() / spread > scipy.stats.t.isf((1 - CONFIDENCE) / TRIED, len(gap) - 1))


def _rms(values: Real) -> float:
    return float(np.sqrt(np.mean(values**2)))
