"""Other forms of the model, the number of samples, and units in the far tails."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.config.studies.study import ALL_LIMITS
from pipeline.figures.labels import METRICS
from pipeline.figures.yields import sample_convergence_figure
from pipeline.model.metrics import signed_number
from pipeline.report.frames import HEADLINES, Drawing, Frames
from pipeline.report.layout import DASH, count_text, interval, number, percent, percent_interval, plain_number
from pipeline.report.results import Cell, Results, needed_units, yield_estimate
from pipeline.report.sections.section import Section
from pipeline.statistics.intervals import Estimate, units_for_yield

MILLION = 1e6
"""Parts of a whole."""


@dataclass(frozen=True)
class TailLine:
    """One metric as text: its limit, units beyond it, its far quantile, and how many units know each as well."""

    name: str
    title: str
    unit: str
    limit: str
    exceedance: Cell
    beyond_effective: str
    level: str
    quantile: Cell
    quantile_effective: str


def tail_lines(frames: Frames) -> list[TailLine]:
    """A line for each metric that has a far tail; none where the study does not ask for them."""
    lines = []
    for metric, rows in frames.tails.groupby("metric", sort=False, observed=True):
        quantity, results = METRICS[metric], Results(frames)
        exceeding, distant = (rows[(rows["statistic"] == "beyond") == shares].iloc[0] for shares in (True, False))
        ends = [min(max(MILLION * float(exceeding[end]), 0.0), MILLION) for end in ("value", "ci_low", "ci_high")]
        lines.append(
            TailLine(
                name=metric,
                title=quantity.title,
                unit=quantity.unit,
                limit=results.limit(metric),
                exceedance=Cell(f"{ends[0]:,.0f}", f"{ends[1]:,.0f} to {ends[2]:,.0f}"),
                beyond_effective=f"{exceeding['effective']:,.0f}",
                level=f"{str(distant['statistic']).removeprefix('p')} %",
                quantile=Cell(
                    number(distant["value"], quantity), interval(distant["ci_low"], distant["ci_high"], quantity)
                ),
                quantile_effective=f"{distant['effective']:,.0f}",
            )
        )
    return lines


@dataclass(frozen=True)
class SamplesSection:
    """What the page says of the number of samples."""

    frames: Frames

    @property
    def share(self) -> Estimate | None:
        """Yield against all limits, over the turn as the limits mean it."""
        return yield_estimate(self.frames.distributions, self.frames.turn_statistic)

    @property
    def end_sentence(self) -> str:
        """How a study with a wanted accuracy came to its number of samples; empty where it states the number."""
        samples, share = self.frames.study.samples, self.share
        if samples.until is None:
            return ""
        count = count_text(samples.count, "sample")
        accuracy = f"±{plain_number(100 * samples.until.yield_half_width)} %"
        if share is None:
            return f"It ended at {count}, the largest number allowed: no unit has a value for every limited metric."
        half = (share.ci_high - share.ci_low) / 2
        if half <= samples.until.yield_half_width:
            return (
                f"Units were added in batches until the interval reached {accuracy}. It ended at {count}, with "
                f"±{100 * half:.2g} %."
            )
        required_units = units_for_yield(
            share.value, samples.until.yield_half_width, self.frames.study.metrics.confidence
        )
        return (
            f"It ended at {count}, the largest number allowed (samples.until.at_most), with a half width of "
            f"±{100 * half:.2g} %, not {accuracy}, which requires about {required_units:,} units."
        )

    @property
    def rows(self) -> list[tuple[str, str]]:
        """Half widths and the units that they take."""
        if self.share is None or self.frames.study.samples.has_replicates:
            return []
        units_of_widths = needed_units(self.share, self.frames.study.metrics.confidence)
        return [(f"±{plain_number(100 * width)} %", f"{units:,}") for width, units in units_of_widths]

    @property
    def interval(self) -> str:
        """Ends of the yield's interval."""
        return "" if self.share is None else percent_interval(self.share.ci_low, self.share.ci_high)


def sample_drawings(frames: Frames) -> Iterator[Drawing]:
    """The figure of the section; none of samples too few to tell how anything moves."""
    rows = frames.sample_convergence
    if rows["n"].nunique() < 3:
        return
    stop_rule = frames.study.samples.until
    dotted_text = ", dotted the accuracy that was asked for" if stop_rule else ""
    yield Drawing(
        "sample_convergence",
        "Convergence with sample size",
        f"Each estimate from the first samples alone, {frames.turn_statistic} value over the turn; bands are "
        f"{plain_number(100 * frames.study.metrics.confidence)} % intervals, drawn where both ends are "
        f"determined{dotted_text}. "
        "A curve wanders within its band, since each point holds the samples of those before it.",
        partial(
            sample_convergence_figure,
            rows,
            frames.limits,
            ALL_LIMITS,
            stop_rule.yield_half_width if stop_rule else None,
        ),
    )


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


FORMS = Section(
    name="forms",
    title="Other forms of the model",
    rank=23,
    template=Path(__file__).with_name("forms.html"),
    values=lambda page: {"forms": FormResults(page.frames, page.results), "metric_labels": METRICS},
    applies=lambda frames: len(frames.tables.get(FORM_TABLES[0], ())) > 0,
    tables=FORM_TABLES,
)


SAMPLES = Section(
    name="samples",
    title="How many samples",
    rank=30,
    template=Path(__file__).with_name("samples.html"),
    values=lambda page: {"samples": SamplesSection(page.frames)},
    applies=lambda frames: not frames.is_listed and len(frames.over_turn) > 0,
    drawings=sample_drawings,
)


TAILS = Section(
    name="tails",
    title="Far tails",
    rank=40,
    template=Path(__file__).with_name("tails.html"),
    values=lambda page: {"tail_lines": tail_lines(page.frames)},
    applies=lambda frames: len(frames.tails) > 0,
)

SECTIONS = (FORMS, SAMPLES, TAILS)
