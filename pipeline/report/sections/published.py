"""Measured units of the drive that others published, beside the predicted distributions."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import assembly
from pipeline.arrays import Real
from pipeline.figures.distributions import published_figure
from pipeline.figures.labels import LIMITED_METRICS, METRICS
from pipeline.report.frames import Drawing, Frames
from pipeline.report.layout import count_text, interval, number, percent, plain_number
from pipeline.report.sections.section import Section

OF_UNITS = (5, 50, 95)
"""Percentiles of the predicted units that are shown."""
MOST_LARGER = 6
"""Unnamed orders that are listed at most."""


@dataclass(frozen=True)
class Row:
    """A measured number of a published unit beside the predicted distribution, as text."""

    label: str
    title: str
    unit: str
    measured: str
    median: str
    spread: str
    below: str


@dataclass(frozen=True)
class Published:
    """The published units of a study, and the predictions of what was measured of them."""

    frames: Frames

    @property
    def units(self) -> list[str]:
        """Their labels."""
        return [unit.label for unit in self.frames.study.published]

    @cached_property
    def predicted_values(self) -> dict[str, Real]:
        """Values (n_units,) of the random units by each metric that was measured of some published unit."""
        names = [
            name for name in LIMITED_METRICS if any(name in unit.of_metrics for unit in self.frames.study.published)
        ]
        random = self.frames.units[self.frames.units["sample"] >= self.frames.first_random]
        columns = {name: f"{name}_{self.frames.turn_statistic}" if name in METRICS else name for name in names}
        return {name: random[column].dropna().to_numpy(float) for name, column in columns.items()}

    @property
    def rows(self) -> list[Row]:
        """Every measured number beside the predicted ones."""
        return [
            self._row(unit.label, name, value)
            for unit in self.frames.study.published
            for name, value in unit.of_metrics.items()
        ]

    def _row(self, label: str, name: str, value: float) -> Row:
        quantity, values = LIMITED_METRICS[name], self.predicted_values[name]
        low, median, high = np.percentile(values, OF_UNITS) if len(values) else (np.nan,) * 3
        measured, predicted = number(value, quantity), number(float(median), quantity)
        ends = interval(float(low), float(high), quantity)
        share_below = percent(float(np.mean(values < value)) if len(values) else np.nan)
        return Row(label, quantity.title, quantity.unit, measured, predicted, ends, share_below)

    @property
    def sentences(self) -> list[str]:
        """Source and conditions of each unit."""
        units = self.frames.study.published
        outside = [
            f"{unit.label}: the measured {LIMITED_METRICS[name].title[:1].lower()}{LIMITED_METRICS[name].title[1:]} is "
            f"{'larger' if value > self.predicted_values[name].max() else 'smaller'} than that of every predicted "
            "unit; the stated tolerances and this model do not predict it."
            for unit in units
            for name, value in unit.of_metrics.items()
            if len(self.predicted_values[name])
            and not self.predicted_values[name].min() <= value <= self.predicted_values[name].max()
        ]
        sources = [f"{unit.label}: {unit.note}{'. ' if unit.note else ''}Source: {unit.source}." for unit in units]
        return [*outside, *sources]

    @property
    def torque(self) -> str:
        """The torque that is held [N m]."""
        return plain_number(assembly.definitions(self.frames.study).rigidity_high)

    @cached_property
    def orders(self) -> pd.DataFrame:
        """Quantiles of the amplitude under load [arcsec] by order of the output turn; no rows where none are known."""
        rows, turns = self.frames.orders, self.frames.study.cycle.crank_turns
        is_chosen = (rows["torque_Nm"] > 0) & (rows["sense"] == "+") & (rows["sample"] >= self.frames.first_random)
        loaded_rows = rows[is_chosen]
        order = np.round(loaded_rows["order"] * turns).astype(int)
        by_order = loaded_rows["amplitude_arcsec"].groupby(order.rename("order"))
        quantiles = by_order.quantile([0.5, 0.95]).unstack() if len(loaded_rows) else pd.DataFrame(columns=[0.5, 0.95])
        return quantiles.set_axis(["middle", "high"], axis=1)

    @cached_property
    def named_orders(self) -> list[int]:
        """Orders of the output turn that the sources name, as far as they are predicted."""
        order_set = sorted({order for unit in self.frames.study.published for order in unit.orders})
        return [order for order in order_set if order in self.orders.index]

    @property
    def order_rows(self) -> list[tuple[str, str, str, str]]:
        """Of each named order its predicted amplitude, and its place among all."""
        places = self.orders["middle"].rank(ascending=False)
        return [
            (
                str(order),
                f"{self.orders.loc[order, 'middle']:.2g}",
                f"{self.orders.loc[order, 'high']:.2g}",
                f"{places[order]:.0f}",
            )
            for order in self.named_orders
        ]

    @property
    def highest(self) -> int:
        """The highest order of the output turn that is told apart."""
        return int(self.orders.index.max())

    @property
    def larger(self) -> list[str]:
        """Orders that the sources do not name, predicted larger than the smallest named one, the largest first."""
        other_orders = self.orders["middle"].drop(self.named_orders)
        least_named = self.orders.loc[self.named_orders, "middle"].min()
        larger = other_orders[other_orders > least_named].sort_values(ascending=False)[:MOST_LARGER]
        return [f"{order} ({amplitude:.2g} arcsec)" for order, amplitude in larger.items()]

    @property
    def counted_units(self) -> str:
        """How many units the orders are of."""
        samples = self.frames.orders["sample"]
        return count_text(int(samples[samples >= self.frames.first_random].nunique()), "unit")


def _drawings(frames: Frames) -> Iterator[Drawing]:
    published_units = Published(frames)
    values = {name: column for name, column in published_units.predicted_values.items() if len(column) > 1}
    if values:
        measured_values = {
            name: {unit.label: unit.of_metrics[name] for unit in frames.study.published if name in unit.of_metrics}
            for name in values
        }
        waves = published_units.orders if published_units.named_orders else None
        text = (
            " Right: amplitude of each order, median and 95 % quantile; named orders have a mark."
            if waves is not None
            else ""
        )
        yield Drawing(
            "published",
            "Measured units beside the prediction",
            f"Histogram of the predicted units; each line is a measured unit.{text}",
            partial(published_figure, values, measured_values, waves, published_units.named_orders),
        )


SECTION = Section(
    name="published",
    title="Measured units",
    rank=15,
    template=Path(__file__).with_suffix(".html"),
    values=lambda page: {"published": Published(page.frames)},
    applies=lambda frames: bool(frames.study.published) and not frames.is_listed,
    drawings=_drawings,
)
