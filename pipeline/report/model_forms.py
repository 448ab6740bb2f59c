"""How the yield and the metrics of a study move under other forms of the model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.config.studies.study import ALL_LIMITS
from pipeline.figures.labels import METRICS
from pipeline.model.metrics import signed_number
from pipeline.report.frames import HEADLINES, Frames
from pipeline.report.layout.wording import DASH, interval, number, percent, percent_interval
from pipeline.report.results import Cell, Results

OK, OF_STUDY, YIELD = "ok", "as stated", "yield"
FORM_TABLES = ("forms/forms", "forms/estimates")
"""Tables that the page reads."""


@dataclass(frozen=True)
class FormRow:
    """One form: its yield, the difference from the study's own form, mean metrics, and the reason of a missing one."""

    title: str
    rescaled: bool
    factor: str
    met: Cell
    difference: Cell
    means: tuple[Cell, ...]
    reason: str


@dataclass(frozen=True)
class FormRange:
    """Lowest and highest yield that forms of the model give to the study, and the form of the lowest."""

    low: float
    high: float
    lowest: str

    @property
    def text(self) -> str:
        """The range in percent."""
        return percent_interval(self.low, self.high)


@dataclass(frozen=True)
class FormResults:
    """The tables of the stage `forms` as the page tells them."""

    frames: Frames
    results: Results

    @property
    def forms(self) -> pd.DataFrame:
        """One row a form; none without the setting."""
        return self.frames.tables.get(FORM_TABLES[0], pd.DataFrame(columns=["form", "rescaled", "title", "status"]))

    @property
    def estimates(self) -> pd.DataFrame:
        """Rows of statistics."""
        return self.frames.tables[FORM_TABLES[1]]

    @property
    def units(self) -> int:
        """Units that were solved under every form."""
        return int(self.estimates["n"].max())

    @property
    def metrics(self) -> list[str]:
        """Headline metrics and those with a limit, as far as they vary."""
        metric_names = set(self.estimates["metric"])
        return [name for name in METRICS if name in metric_names and (name in HEADLINES or name in self.frames.limits)]

    def yield_range(self, is_rescaled: bool) -> FormRange | None:
        """Yields of all limits: the study's own, moved as the same units move under each form; None without forms.

        Parameters
        ----------
        is_rescaled : of the forms with the mean rigidity of the study's own, or of those as stated.
        """
        if not len(self.forms):
            return None
        rows = self.estimates[(self.estimates["metric"] == ALL_LIMITS) & (self.estimates["form"] != OF_STUDY)]
        rows = rows[rows["rescaled"] == is_rescaled]
        own_yield = self.results.estimate(ALL_LIMITS, YIELD)[0]
        if not len(rows) or not np.isfinite(own_yield):
            return None
        moved_yields = np.clip(own_yield + rows["difference"].to_numpy(float), 0.0, 1.0)
        names = rows["form"].to_numpy()
        title = self.forms.set_index("form")["title"].to_dict()[names[moved_yields.argmin()]]
        return FormRange(min(own_yield, moved_yields.min()), max(own_yield, moved_yields.max()), str(title))

    @property
    def rows(self) -> Iterator[FormRow]:
        """All forms in their order, those as stated first."""
        estimates = self.estimates.set_index(["form", "rescaled", "metric", "statistic"]).sort_index()
        for form in self.forms.itertuples():
            factor = number(form.deflection_factor, METRICS["torsional_rigidity_Nm_per_arcmin"])
            if form.status != OK:
                yield FormRow(form.title, form.rescaled, DASH, Cell(DASH), Cell(DASH), (), form.status)
                continue
            of_form = estimates.loc[(form.form, form.rescaled)]
            means = tuple(self._mean(of_form, name) for name in self.metrics)
            yield FormRow(form.title, form.rescaled, factor, *self._shares(of_form), means, "")

    def _mean(self, of_form: pd.DataFrame, name: str) -> Cell:
        if (name, "mean") not in of_form.index:
            return Cell(DASH)
        row = of_form.loc[(name, "mean")]
        return Cell(number(row["value"], METRICS[name]), interval(row["ci_low"], row["ci_high"], METRICS[name]))

    def _shares(self, of_form: pd.DataFrame) -> tuple[Cell, Cell]:
        if (ALL_LIMITS, YIELD) not in of_form.index:
            return Cell(DASH), Cell(DASH)
        row = of_form.loc[(ALL_LIMITS, YIELD)]
        ends = (signed_number(100 * row[f"difference_{end}"], 1) for end in ("ci_low", "ci_high"))
        difference = Cell(signed_number(100 * row["difference"], 1), " to ".join(ends))
        return Cell(percent(row["value"]), percent_interval(row["ci_low"], row["ci_high"])), difference
