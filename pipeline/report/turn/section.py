"""The numbers of the section: each metric of the turn over the samples, and why one is not known."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from pipeline import assembly
from pipeline.model.metrics.turn import FEWEST_ANGLES, NEEDS, TurnMetric, turn_library
from pipeline.model.metrics.turn.turn_metric import BALANCE, FRICTION, RATING, SPEED, TURN
from pipeline.report.frames import Frames, case_label
from pipeline.report.layout.wording import DASH, interval, listed_text, number, percent, percent_interval, plain_number
from pipeline.report.results import STATISTICS, Cell

CASES_SHOWN = 12
"""Listed cases in the table; all of them stand in the table of units."""


@dataclass(frozen=True)
class TurnRow:
    """One metric of the turn as text: of the nominal reducer, over the samples, its limit and its yield."""

    title: str
    unit: str
    values: tuple[str, ...]
    estimates: tuple[Cell, ...]
    limit: str
    share_within: Cell


@dataclass(frozen=True)
class TurnSection:
    """What the page says of the turn."""

    frames: Frames

    @cached_property
    def _estimates(self) -> pd.DataFrame:
        table = self.frames.distributions
        return table[table["over"] == "turn"].set_index(["metric", "statistic"])[["value", "ci_low", "ci_high"]]

    def _estimate(self, name: str, statistic: str) -> tuple[float, float, float]:
        key = name, statistic
        return tuple(self._estimates.loc[key]) if key in self._estimates.index else (np.nan, np.nan, np.nan)

    @cached_property
    def shown_samples(self) -> list[int]:
        """Samples with a column of their own: the nominal reducer, or the listed cases."""
        count = min(self.frames.study.samples.rows, CASES_SHOWN)
        return list(range(count)) if self.frames.is_listed else [0] * self.frames.study.samples.nominal_first

    @property
    def columns(self) -> list[str]:
        """Their labels."""
        return [case_label(self.frames.study, sample) for sample in self.shown_samples]

    @cached_property
    def rows(self) -> list[TurnRow]:
        """The metrics that are known of some unit."""
        return [self._row(name, metric) for name, metric in turn_library().items() if self._is_known(name)]

    def _is_known(self, name: str) -> bool:
        return bool(self.frames.units[name].notna().any())

    def _row(self, name: str, metric: TurnMetric) -> TurnRow:
        units = self.frames.units.set_index("sample")[name]
        cells = []
        for statistic in STATISTICS:
            value, low, high = self._estimate(name, statistic)
            cells.append(Cell(number(value, metric), interval(low, high, metric) if np.isfinite(value) else ""))
        share, low, high = self._estimate(name, "yield")
        limits = self.frames.limits
        side = "≥" if metric.smaller_is_worse else "≤"
        return TurnRow(
            metric.title,
            metric.unit,
            tuple(number(float(units[sample]), metric) for sample in self.shown_samples),
            () if self.frames.is_listed else tuple(cells),
            f"{side} {plain_number(limits[name])}" if name in limits else DASH,
            Cell(percent(share), percent_interval(low, high)) if np.isfinite(share) else Cell(DASH),
        )

    @property
    def has_limits(self) -> bool:
        """Whether a metric of the turn has a limit and the samples are random."""
        return not self.frames.is_listed and any(name in self.frames.limits for name in turn_library())

    @cached_property
    def missing_needs(self) -> set[str]:
        """What the study or its design does not have, of ``NEEDS``."""
        operation, has_rank = self.frames.study.design.operation, bool(self.told_apart)
        available = {
            TURN: has_rank,
            BALANCE: not has_rank or self._is_known("bearing_force_peak_N"),
            SPEED: operation is not None,
            RATING: operation is not None and operation.rating is not None,
            FRICTION: operation is not None and operation.friction is not None,
        }
        return {need for need, present in available.items() if not present}

    @property
    def unknown_metrics(self) -> list[str]:
        """The metrics that no unit has, each with what it needs and what the study lacks of that."""
        texts = []
        for name, metric in turn_library().items():
            if not self._is_known(name):
                missing = [need for need in metric.needs if need in self.missing_needs] or metric.needs
                texts.append(f"{metric.title}: it needs {listed_text([NEEDS[need] for need in missing])}.")
        return texts

    @property
    def definitions(self) -> list[tuple[str, str, str]]:
        """Name, title and definition of every metric of the turn."""
        torques = vars(assembly.definitions(self.frames.study))
        return [(metric.name, metric.title, metric.definition.format(**torques)) for metric in turn_library().values()]

    @property
    def torque(self) -> str:
        """The torque that is held [N m]."""
        return plain_number(assembly.definitions(self.frames.study).rigidity_high)

    @property
    def told_apart(self) -> int:
        """Highest order under load that the loaded angles tell apart; 0 where they tell none."""
        is_loaded = self.frames.orders["torque_Nm"] != 0
        angles = len(self.frames.study.cycle.crank_deg)
        return (angles - 1) // 2 if is_loaded.any() and angles >= FEWEST_ANGLES else 0

    @cached_property
    def folded_share(self) -> str:
        """Share of the unloaded error's variance in orders that the loaded angles do not tell apart, in the mean."""
        rows = self.frames.orders
        free_rows = rows[(rows["torque_Nm"] == 0) & (rows["sample"] >= self.frames.first_random)]
        power = free_rows["amplitude_arcsec"] ** 2
        return percent(float(power[free_rows["order"] > self.told_apart].sum() / power.sum())) if power.sum() else ""
