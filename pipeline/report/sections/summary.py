"""The answer first: a card for each limit, which limit fails and why, and what the yield holds for."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arrays import Truth
from pipeline.config.studies.study import ALL_LIMITS
from pipeline.figures.labels import LIMITED_METRICS
from pipeline.figures.yields import failures_figure
from pipeline.model.metrics import library
from pipeline.model.metrics.turn import turn_library
from pipeline.populations.scaled_tolerances import FEWEST_PAIRS, scaled_tolerances
from pipeline.report.frames import OK, Drawing, Frames
from pipeline.report.layout import count_text, interval, percent, percent_interval
from pipeline.report.results import Cell, Results, preload_warning
from pipeline.report.sections.drivers import REMOVED_VARIANCES, main_contributor, share_notes
from pipeline.report.sections.further import FormResults
from pipeline.report.sections.section import Page, Section
from pipeline.report.single_changes import SCALED_YIELDS, SingleChanges, next_target

MEASURED = ("published", "given")
"""Origins of a number that was not adjusted to a result of the model."""


@dataclass(frozen=True)
class LimitCard:
    """One limit: the yield against it, how the metric is distributed, and the tolerance that drives it."""

    name: str
    title: str
    limit: str
    met: Cell
    spread: str
    contributor: str


@dataclass(frozen=True)
class Verdict:
    """What the page says first of a study with random units."""

    frames: Frames
    results: Results

    @cached_property
    def cards(self) -> list[LimitCard]:
        """One card for each limit, the worst yield first; a metric without a yield stands last."""
        yields = {name: self.results.estimate(name, "yield")[0] for name in self.frames.limits}
        order = sorted(yields, key=lambda name: (bool(np.isnan(yields[name])), yields[name]))
        return [self._card(name) for name in order]

    def _card(self, name: str) -> LimitCard:
        metric = LIMITED_METRICS[name]
        low, high = (self.results.estimate(name, statistic)[0] for statistic in ("p05", "p95"))
        return LimitCard(
            name=name,
            title=metric.title,
            limit=f"{self.results.limit(name)}{'' if metric.unit == '1' else f' {metric.unit}'}",
            met=self.results.share(name, "yield"),
            spread=f"{interval(low, high, metric)} {metric.unit}".removesuffix(" 1") if np.isfinite(low) else "",
            contributor=main_contributor(self.frames, name),
        )

    @property
    def no_contributor(self) -> str:
        """What stands in place of a main contributor where none is determined, and what would determine it."""
        study, n_units = self.frames.study, len(self.frames.over_turn)
        if not scaled_tolerances(study):
            return "no tolerance contributes, since none varies"
        if n_units < FEWEST_PAIRS:
            return f"no main contributor is determined from {count_text(n_units, 'unit')}; run {FEWEST_PAIRS} or more"
        needs = "state more base_samples" if study.drivers.base_samples else "state base_samples"
        return f"no main contributor is determined; {needs} under [drivers] for shares of the variance"

    @property
    def share_notes(self) -> list[str]:
        """What the shares of the main contributors are, of the first card that has each measure."""
        return share_notes(self.frames, [card.name for card in self.cards])

    @cached_property
    def limited_values(self) -> pd.DataFrame:
        """(n,) metrics with a limit, by sample, of the units for which all of them hold."""
        turn = self.frames.units.set_index("sample")[list(turn_library())]
        values: pd.DataFrame = self.frames.over_turn.join(turn)[list(self.frames.limits)].dropna()
        return values

    @cached_property
    def breaks(self) -> Mapping[str, Truth]:
        """Whether each unit (n,) breaks each limit, of the units for which every limited metric holds."""
        values = {name: column.to_numpy(float) for name, column in self.limited_values.items()}
        return {name: ~np.asarray(passes) for name, passes in self.frames.study.limits.pass_flags(values).items()}

    @property
    def not_counted(self) -> str:
        """How many units have no value of a metric with a limit, why, and the yield if all of them failed."""
        nominal = [0] if self.frames.study.samples.nominal_first else []
        samples = self.frames.units["sample"][~self.frames.units["sample"].isin(nominal)]
        missing = samples[~samples.isin(self.limited_values.index)]
        if not len(missing) or ALL_LIMITS not in self.breaks:
            return ""
        rows = self.frames.metrics[self.frames.metrics["sample"].isin(missing)]
        reasons = rows["status"].astype(str)[rows["status"] != OK].mode()
        reason = f" (most often: {reasons.iloc[0].partition(' (')[0]})" if len(reasons) else ""
        least = float(np.sum(~self.breaks[ALL_LIMITS])) / len(samples)
        return (
            f"This leaves out {len(missing):,} of {count_text(len(samples), 'unit')} without a value of a metric that "
            f"has a limit{reason}. If all of them failed, the yield would be {percent(least)}; the lower end of its "
            "interval counts them so."
        )

    @property
    def failures(self) -> str:
        """Which limit is broken in what share of the failing units, and which tolerance drives that metric."""
        if ALL_LIMITS not in self.breaks or not self.results.all_limits.interval:
            return ""
        failing = self.breaks[ALL_LIMITS]
        value, low, high = self.results.estimate(ALL_LIMITS, "yield")
        if not failing.any():
            return f"No unit of {len(failing):,} fails a limit; the failing share is at most {percent(1 - low)}."
        shares = {name: float(np.mean(broken[failing])) for name, broken in self.breaks.items() if name != ALL_LIMITS}
        worst_limit = max(shares, key=lambda name: shares[name])
        contributor = main_contributor(self.frames, worst_limit)
        driver_text = f"its main contributor is the {contributor}" if contributor else self.no_contributor
        return (
            f"{percent(1 - value)} of the units fail (95 % CI {percent_interval(1 - high, 1 - low)}); "
            f"{percent(shares[worst_limit])} of these on {LIMITED_METRICS[worst_limit].inline}; {driver_text}."
        ).replace("95 % CI", f"{100 * self.frames.study.metrics.confidence:g} % CI")

    @property
    def advice(self) -> str:
        """What to do where units fail: the command that finds the cheapest change, and what it still needs."""
        if not self.failures or not self.breaks[ALL_LIMITS].any():
            return ""
        study = self.frames.study
        target = next_target(self.results.estimate(ALL_LIMITS, "yield")[0])
        command = f"make allocate STUDY={study.name} YIELD={target:g}"
        needs = "" if study.costs.of_dimensions else " First state under [costs] what tolerances cost."
        of_turn = [f"limits.{name}" for name in study.limits.of_metrics if name not in library()]
        if of_turn:
            needs += f" Use a copy of the study without {' and '.join(of_turn)}: an allocation uses metrics of a loop."
        return (
            f"To find the cheapest tolerances for a yield of {percent(target)}, run: {command}.{needs} It changes all "
            "priced tolerances together and checks the result on new load-solved units."
        )

    @property
    def preload_warning(self) -> str:
        """A warning where most units are preloaded; else empty."""
        return preload_warning(self.frames.distributions)

    @property
    def holds_for(self) -> str:
        """Which crank angles the yield counts, and on which side of it the yield of a whole turn lies."""
        if self.frames.turn_statistic != "worst":
            return f"It counts the {self.frames.turn_statistic} value of each unit over {self.results.angles}."
        if self.results.n_searched:
            return f"It holds for the whole turn of the output{self._not_searched}."
        angles = count_text(int(self.frames.units.iloc[0]["n_angles"]), "loaded crank angle")
        doubled_yield = self.results.doubled_yield
        doubling_text = f" (with twice as many an estimated {doubled_yield})" if doubled_yield else ""
        return f"It counts {angles}{doubling_text}; over the whole turn of the output the yield is at most this."

    @property
    def _not_searched(self) -> str:
        """Which limits of metrics of the turn are read at the study's angles alone, as the end of a sentence."""
        of_turn = [name for name in self.frames.limits if name in turn_library()]
        of_play = {
            name: turn_library()[name].of_play for name in of_turn if not self.results.is_of_whole_turn(name, "yield")
        }
        if not of_play:
            return ""
        counts = self.frames.units.iloc[0]
        columns = {"n_rigid_angles" if is_of_play else "n_angles" for is_of_play in of_play.values()}
        angles = " and ".join(f"{int(counts[column]):,}" for column in sorted(columns))
        titles = " and the ".join(LIMITED_METRICS[name].inline for name in of_play)
        return f", but for the {titles}: of {angles} crank angles, between which the worst may be larger"

    @property
    def rigidity_note(self) -> str:
        """That the rigidity of an RV reducer is put in, by the stiffness of its crank bearings; empty of others."""
        design = self.frames.study.design
        origin = design.provenance.get("bearing.stiffness_N_per_mm_power")
        if not design.output.carries_disks or (origin and origin.status in MEASURED):
            return ""
        stated = f"{origin.status}: {origin.reason}" if origin else "without a stated origin"
        return (
            "The torsional rigidity is an input of this design, not a prediction: the stiffness of the crank bearings "
            f"sets it ({stated}). From one size of RV reducer to another the model predicts it no better than the cube "
            "of the pin circle's radius does."
        )

    @property
    def angles_note(self) -> str:
        """How the worst crank angle of each unit was searched, or how to search it; empty for other values."""
        if self.frames.turn_statistic != "worst":
            return ""
        if not self.results.n_searched:
            return (
                "Units can fail between the loaded crank angles. To search the worst angle of each unit, state "
                "loaded_angles = 31 under [cycle] of the study, without crank_deg and turn."
            )
        n_audited = min(self.frames.study.cycle.audited_units, len(self.frames.over_turn))
        return (
            f"The worst crank angle of each unit was searched: {self.results.n_searched:,} pitches of the pins were "
            f"ranked, and the most promising load-solved. {n_audited} random units, solved at all pitches, correct "
            "what that misses; the interval includes it."
        )


def _values(page: Page) -> Mapping[str, object]:
    forms = FormResults(page.frames, page.results)
    return {
        "verdict": Verdict(page.frames, page.results),
        "changes": SingleChanges.from_frames(page.frames, page.results.estimate(ALL_LIMITS, "yield")),
        "as_stated": forms.yield_range(is_rescaled=False),
        "rescaled": forms.yield_range(is_rescaled=True),
    }


def _drawings(frames: Frames) -> Iterator[Drawing]:
    results = Results(frames)
    breaks = dict(Verdict(frames, results).breaks)
    failing = breaks.pop(ALL_LIMITS, np.zeros(0, bool))
    if failing.any():
        changes = SingleChanges.from_frames(frames, results.estimate(ALL_LIMITS, "yield"))
        curves = changes.curves()
        as_found = " Units count as the search found them; the yields above are corrected for what it misses."
        scaled_yields = (
            " Right: estimated yield against all limits if one tolerance alone is scaled, the five of the widest span; "
            "the band is the interval of the first, the dotted line is the next target."
        )
        yield Drawing(
            "failures",
            "Limits that the failing units break, and the yield against the scale of each tolerance"
            if curves
            else "Limits that the failing units break",
            f"{'Left: share' if curves else 'Share'} of {len(failing):,} units; a unit that breaks two limits counts "
            f"in both bars.{as_found if results.n_searched else ''}{scaled_yields if curves else ''}",
            partial(failures_figure, breaks, curves, changes.target),
        )


SECTION = Section(
    name="summary",
    title="Summary",
    rank=5,
    template=Path(__file__).with_suffix(".html"),
    values=_values,
    applies=lambda frames: not frames.is_listed and len(frames.over_turn) > 0,
    drawings=_drawings,
    tables=(SCALED_YIELDS, REMOVED_VARIANCES),
)
