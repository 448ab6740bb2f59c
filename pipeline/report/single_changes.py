"""Which one tolerance, scaled alone, brings the yield to a target: an estimate, from the table of scaled yields."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.config.studies.study import ALL_LIMITS, Study
from pipeline.decisions.cheapest import Priced
from pipeline.figures.labels import PARAMETERS
from pipeline.report.frames import Frames
from pipeline.report.layout import percent, percent_interval, rounded_number

SCALED_YIELDS = "scales/yields"
TARGETS = (0.9, 0.95, 0.99, 0.999)
"""Yields of which the first above that of a study is aimed at."""


def next_target(value: float) -> float:
    """The first of `TARGETS` above a yield."""
    return next((target for target in TARGETS if target > value), TARGETS[-1])


@dataclass(frozen=True)
class SingleChange:
    """One tolerance scaled alone.

    Attributes
    ----------
    scale : factor on its limits.
    value, ci_low, ci_high : estimated yield against all limits there.
    cost : of the tolerance there less what it costs now; NaN where no cost is stated.
    """

    tolerance: str
    scale: float
    value: float
    ci_low: float
    ci_high: float
    cost: float


@dataclass(frozen=True)
class SingleChanges:
    """How the yield against all limits follows the scale of each tolerance of a study.

    Attributes
    ----------
    rows : the table of scaled yields.
    stated_yield : yield of the study with the ends of its interval.
    """

    study: Study
    rows: pd.DataFrame
    stated_yield: tuple[float, float, float]

    @classmethod
    def from_frames(cls, frames: Frames, stated_yield: tuple[float, float, float]) -> "SingleChanges":
        """From the tables of a run; without rows where it has no such table."""
        rows = frames.tables.get(SCALED_YIELDS, pd.DataFrame(columns=["tolerance", "scale", "metric"]))
        return cls(frames.study, rows, stated_yield)

    @property
    def target(self) -> float:
        """The yield that is aimed at."""
        return next_target(self.stated_yield[0])

    def curves(self, metric: str = ALL_LIMITS) -> Mapping[str, np.ndarray]:
        """By tolerance scales, yields and the ends of their intervals (4, n), scale 1 among them; widest span first."""
        rows, curves = self.rows[self.rows["metric"] == metric], {}
        for name, part in rows.groupby("tolerance", sort=False):
            points = part[["scale", "value", "ci_low", "ci_high"]].to_numpy(float)
            here = (1.0, *self.stated_yield) if metric == ALL_LIMITS else (1.0, np.nan, np.nan, np.nan)
            points = np.vstack([points, here])[np.argsort([*points[:, 0], 1.0])]
            curves[str(name)] = points[np.isfinite(points).all(axis=1)].T
        return dict(sorted(curves.items(), key=lambda item: -np.ptp(item[1][1])))

    @property
    def best_change(self) -> SingleChange | None:
        """The change that reaches the target for the least cost, or by the least scaling where costs are not stated."""
        changes = [change for name in self.curves() if (change := self._reaching(name))]
        priced_changes = [change for change in changes if np.isfinite(change.cost)]
        if priced_changes:
            return min(priced_changes, key=lambda change: change.cost)
        return min(changes, key=lambda change: abs(np.log(change.scale)), default=None)

    @property
    def largest_yield_change(self) -> SingleChange | None:
        """The change of the largest yield; None where no change improves it."""
        points = [(curve[1].max(), name, curve) for name, curve in self.curves().items()]
        if not points or max(points, key=lambda point: point[0])[0] <= self.stated_yield[0]:
            return None
        _, name, curve = max(points, key=lambda point: point[0])
        k = int(np.argmax(curve[1]))
        scale, value, low, high = map(float, curve[:, k])
        return SingleChange(name, scale, value, low, high, self._added_cost(name, scale))

    def _reaching(self, name: str) -> SingleChange | None:
        """The scale nearest to 1 at which the straight lines between the scales reach the target."""
        scales, values, lows, highs = self.curves()[name]
        crossings = []
        for a, b in zip(range(len(scales) - 1), range(1, len(scales)), strict=True):
            if (values[a] - self.target) * (values[b] - self.target) <= 0 and values[a] != values[b]:
                share = (self.target - values[a]) / (values[b] - values[a])
                crossings.append(float(scales[a] + share * (scales[b] - scales[a])))
        if not crossings:
            return None
        scale = min(crossings, key=lambda crossing: abs(np.log(crossing)))
        low, high = (float(np.interp(scale, scales, side)) for side in (lows, highs))
        return SingleChange(name, scale, self.target, low, high, self._added_cost(name, scale))

    def _added_cost(self, name: str, scale: float) -> float:
        costs = self.study.costs.of_dimensions
        if name not in costs:
            return np.nan
        low, high = getattr(self.study.tolerances, name).limits_um
        price = Priced(name, high - low, costs[name], costs[name].count(name, self.study.design))
        return float(price.cost_at(np.array(scale)) - price.cost_at(np.array(1.0)))

    @property
    def sentence(self) -> str:
        """What to change first, what it costs and how sure that is; empty without an estimate."""
        if not len(self.rows):
            return ""
        if self.best_change is not None:
            return (
                f"To reach a yield of {percent(self.target)}, {self._change_text(self.best_change)}. {self._sureness}"
            )
        if self.largest_yield_change is None:
            return (
                "No tolerance, scaled alone between a quarter and twice its limits, raises the yield noticeably. "
                f"Change an allowance or a limit, or several tolerances together. {self._sureness}"
            )
        is_shown = self.largest_yield_change.ci_low > self.stated_yield[0]
        doubt = "" if is_shown else " Its interval contains the present yield: the gain is not significant."
        return (
            f"No single tolerance reaches a yield of {percent(self.target)}. The largest estimated gain: "
            f"{self._change_text(self.largest_yield_change)}.{doubt} {self._sureness}"
        )

    def _change_text(self, change: SingleChange) -> str:
        stated_text, scaled_text = (" to ".join(rounded_number(end) for end in ends) for ends in self._ends(change))
        verb = "tighten" if change.scale < 1 else "loosen"
        cost = f" The cost rises by {change.cost:.3g}" if change.cost >= 0 else f" The cost falls by {-change.cost:.3g}"
        priced = np.isfinite(change.cost)
        cost = f"{cost}, by the prices under [costs]" if priced else " The study states no price for it under [costs]"
        return (
            f"{verb} the {PARAMETERS[change.tolerance]} alone from {stated_text} µm to {scaled_text} µm "
            f"({change.scale:.3g} times its limits{self._moved_middle(change)}): estimated yield "
            f"{percent(change.value)} (interval {percent_interval(change.ci_low, change.ci_high)}).{cost}"
        )

    def _moved_middle(self, change: SingleChange) -> str:
        """Where the middle of an unsymmetric zone moves to, which changes the metrics too; else empty."""
        (low, high), (scaled_low, scaled_high) = self._ends(change)
        if low + high == 0:
            return ""
        before, after = (rounded_number(0.5 * total) for total in (low + high, scaled_low + scaled_high))
        return f", so that its middle moves from {before} to {after} µm"

    def _ends(self, change: SingleChange) -> tuple[tuple[float, float], tuple[float, float]]:
        low, high = getattr(self.study.tolerances, change.tolerance).limits_um
        return (low, high), (change.scale * low, change.scale * high)

    @property
    def _sureness(self) -> str:
        """What the estimate rests on."""
        return (
            f"This rests on {int(self.rows['n'].max()):,} units that were solved again at every scale; the interval "
            "includes that they are few."
        )

    @property
    def slider(self) -> Mapping[str, object]:
        """What the page's script shows: by tolerance its limits, and yields with intervals by scale."""
        tolerances = [
            {
                "title": PARAMETERS[name],
                "limits": list(getattr(self.study.tolerances, name).limits_um),
                "points": [[round(float(value), 4) for value in point] for point in curve.T],
            }
            for name, curve in self.curves().items()
        ]
        return {"tolerances": tolerances, "target": self.target} if tolerances else {}
