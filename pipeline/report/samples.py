"""How many samples a yield takes, how a study that continued until it was known has ended, and its far tails."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

from pipeline.config.studies.study import ALL_LIMITS
from pipeline.figures.labels import METRICS
from pipeline.figures.yields import sample_convergence_figure
from pipeline.report.drawing import Drawing
from pipeline.report.frames import Frames
from pipeline.report.known_yield import needed_units, yield_estimate
from pipeline.report.layout.wording import count_text, interval, number, percent_interval, plain_number
from pipeline.report.results import Cell, Results
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
