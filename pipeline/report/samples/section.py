"""How many samples a yield takes, and how a study that went on until it is known has ended."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

from pipeline.config.studies.study import ALL_LIMITS
from pipeline.figures.yields import sample_convergence_figure
from pipeline.report.drawing import Drawing
from pipeline.report.frames import Frames
from pipeline.report.layout.wording import count_text, percent_interval, plain_number
from pipeline.report.samples.known_yield import needed_units, yield_estimate
from pipeline.statistics import Estimate
from pipeline.statistics.sample_size import units_for_yield


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
