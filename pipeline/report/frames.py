"""What a report is made of: the study and its tables, and which of their rows the figures draw."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from pipeline import assembly
from pipeline.arrays import Index, Real
from pipeline.config.designs.design import Design
from pipeline.config.studies.study import Study
from pipeline.figures.labels import METRICS, centred_loops, spread_frame
from pipeline.model.geometry.clearance import Errors, exact_gaps, first_order_gaps
from pipeline.model.metrics.turn import turn_library
from pipeline.model.units import UM_PER_MM
from pipeline.report.layout import count_text, listed_text, plain_number

if TYPE_CHECKING:
    from matplotlib.figure import Figure


DRAWN_CASES = 6
"""Cases that share a figure; more lines could not be told apart."""
ROWS_SHOWN = 40
"""Cases that the page lists."""
OK = "ok"
NOMINAL = "nominal reducer"
HEADLINES = tuple(name for name, metric in METRICS.items() if metric.headline)
"""The metrics that the report is about; others stand beside them in its tables."""


@dataclass(frozen=True)
class Frames:
    """Tables of a run. Rows are sorted by sample, crank angle and what else a table counts, on a full grid.

    Attributes
    ----------
    study : the settings.
    metrics : of ``aggregate``: at least the rows of the first 40 samples, those that are not "ok", and one with a loss.
    units : of ``aggregate``: at least `unit_columns`.
    distributions, convergence, sample_convergence, sensitivity : of ``aggregate``, whole.
    tails : of ``tails``, whole; no rows unless the study asks for them.
    n_loops : loops of the run.
    contacts : of ``clearance``: the nominal contacts at every crank angle.
    gaps, curves : of ``clearance`` and ``hysteresis``: the rows of the first samples, all of them or enough for a band.
    loads : ``hysteresis/contacts`` of the drawn samples, as far as they were kept.
    transmission, orders : of ``aggregate``: the rows of the first samples.
    turn_contacts : of ``hysteresis``: the contacts of the drawn samples over the turn, as far as they were kept.
    laws : of ``springs``.
    mesh : number of triangles and of nodes of the disk; None of a rigid one.
    tables : by "stage/table", whole: those that sections read beyond these.
    """

    study: Study
    metrics: pd.DataFrame
    units: pd.DataFrame
    distributions: pd.DataFrame
    convergence: pd.DataFrame
    sample_convergence: pd.DataFrame
    sensitivity: pd.DataFrame
    tails: pd.DataFrame
    n_loops: int
    contacts: pd.DataFrame
    gaps: pd.DataFrame
    curves: pd.DataFrame
    loads: pd.DataFrame
    transmission: pd.DataFrame
    orders: pd.DataFrame
    turn_contacts: pd.DataFrame
    laws: pd.DataFrame
    mesh: tuple[int, int] | None
    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)

    @property
    def is_listed(self) -> bool:
        """Whether the samples are listed cases, so that there is nothing random about them."""
        return self.study.samples.experiment == "cases"

    @property
    def first_random(self) -> int:
        """The first sample of the statistics: 1 behind a nominal reducer."""
        return int(self.study.samples.nominal_first)

    @property
    def crank_deg(self) -> float:
        """The crank angle of the figures: the study's first."""
        return self.study.cycle.crank_deg[0]

    @cached_property
    def turn_statistic(self) -> str:
        """What of a unit's values over the turn the limits hold for: `worst`, `mean` or `best`."""
        return self.study.limits.over

    @cached_property
    def over_turn(self) -> pd.DataFrame:
        """(n,) metrics over the turn as limits mean it, by sample; without the nominal sample and failed ones."""
        nominal = [0] if self.study.samples.nominal_first else []
        columns = {f"{name}_{self.turn_statistic}": name for name in METRICS}
        metrics = self.units[["sample", *columns]].set_index("sample").rename(columns=columns)
        return metrics[metrics.notna().any(axis=1)].drop(index=nominal, errors="ignore")

    def turn_of(self, sample: int) -> dict[str, float]:
        """Each metric of one sample over the turn, as the limits mean it; NaN where a crank angle has no result."""
        row = self.units[self.units["sample"] == sample]
        return {name: float(row[f"{name}_{self.turn_statistic}"].iloc[0]) if len(row) else np.nan for name in METRICS}

    @cached_property
    def failed_rows(self) -> pd.DataFrame:
        """Rows of `metrics` without a result."""
        return unsolved_rows(self.metrics)

    @cached_property
    def doubtful(self) -> pd.DataFrame:
        """Rows of `metrics` of which some number does not hold though the loads have reached equilibrium."""
        rows = self.metrics[np.asarray(self.metrics["status"]) != OK]
        return rows.drop(index=self.failed_rows.index)

    @cached_property
    def samples_drawn(self) -> dict[str, int]:
        """Sample of each line of a figure, by label: the nominal reducer, or the cases; failed ones left out."""
        return drawn_samples(self.study, self.failed_rows)

    @cached_property
    def band(self) -> Index:
        """Samples whose spread is drawn: those at hand, but for the nominal and failed ones; none of listed cases."""
        at_hand = np.unique(self.curves["sample"].to_numpy())
        left_out = set(self.failed_rows["sample"]) | ({0} if self.study.samples.nominal_first else set())
        return np.array([sample for sample in at_hand if sample not in left_out and not self.is_listed], np.intp)

    @cached_property
    def shown_metrics(self) -> list[str]:
        """Metrics worth a row: without friction the zero-torque width is the backlash and the hysteresis loss nil.

        One disk carries all.
        """
        one_disk = self.study.design.disk.count == 1
        frictionless = not np.any(self.metrics["hysteresis_loss_arcmin"] > 0)
        redundant = [
            name
            for name, metric in METRICS.items()
            if (metric.needs_friction and frictionless) or (metric.needs_disks and one_disk)
        ]
        limits = self.limits
        return [name for name in METRICS if name not in redundant or name in limits]

    @cached_property
    def limits(self) -> dict[str, float]:
        """The limits that the study sets, by metric."""
        return self.study.limits.of_metrics

    @cached_property
    def nominal(self) -> pd.DataFrame:
        """Metrics of the nominal reducer, one row a crank angle that has a result; no rows without such a sample."""
        rows = self.metrics[self.metrics["sample"] == 0] if self.study.samples.nominal_first else self.metrics[:0]
        return rows[np.asarray(rows["status"]) == OK]

    def owner(self, label: str) -> str:
        """A label of `samples_drawn` inside a sentence."""
        return f"the {label}" if label == NOMINAL else label

    def at_crank(self, table: pd.DataFrame) -> pd.DataFrame:
        """Rows at the crank angle of the figures."""
        return table[table["crank_deg"] == self.crank_deg]

    def of_band(self, table: pd.DataFrame, column: str) -> Real:
        """Values (n_band, n_columns) of a table on the full grid, at the crank angle of the figures."""
        samples = table["sample"].to_numpy()
        first_sample, n = int(samples[0]), len(np.unique(samples))
        values = table[column].to_numpy().reshape(n, len(self.study.cycle.curve_crank_deg), -1)
        rows: Real = values[self.band - first_sample, 0]
        return rows


def unit_columns(turn_value: str) -> list[str]:
    """Columns of the table of units that a page names if limits hold for this value (`worst`, ...) over the turn."""
    of_loops = [f"{name}_{turn_value}" for name in METRICS]
    return ["sample", *of_loops, *turn_library(), "n_angles", "n_searched", "n_rigid_angles"]


def unsolved_rows(metrics: pd.DataFrame) -> pd.DataFrame:
    """Rows of the table of metrics that have no result at all."""
    return metrics[metrics[list(METRICS)].isna().all(axis=1)]


def case_label(study: Study, sample: int) -> str:
    """What a sample is called: a case by its label."""
    if sample == 0 and study.samples.nominal_first:
        return NOMINAL
    if study.samples.experiment == "cases":
        return study.cases[sample - int(study.samples.nominal_first)].label
    return f"sample {sample}"


def drawn_samples(study: Study, failed_rows: pd.DataFrame) -> dict[str, int]:
    """Sample of each line of a figure, by label.

    Parameters
    ----------
    study : its samples and cases.
    failed_rows : ``sample`` and ``crank_deg`` of the loops without a result.
    """
    n = min(study.samples.rows, DRAWN_CASES) if study.samples.experiment == "cases" else 1
    failed_samples = set(failed_rows.loc[failed_rows["crank_deg"] == study.cycle.crank_deg[0], "sample"])
    return {case_label(study, sample): sample for sample in range(n) if sample not in failed_samples}


@dataclass(frozen=True)
class Drawing:
    """One figure of the report; `name` is the stem of its files and its place in the page, `figure` draws it."""

    name: str
    title: str
    caption: str
    figure: "Callable[[], Figure]"


def disk_words(design: Design) -> str:
    """Which disk a figure shows, where there are several."""
    return ", disk 0 of several" if design.disk.count > 1 else ""


def band_sentence(frames: Frames, spread: object) -> str:
    """Which samples the band is of."""
    if spread is None:
        return ""
    subset = frames.curves["sample"].iloc[-1] + 1 < frames.study.samples.rows
    return f" The band is over {'the first ' if subset else ''}{count_text(len(frames.band), 'sample')}."


def loop_traces(frames: Frames) -> dict[str, pd.DataFrame]:
    """Loop of each drawn sample at the crank angle of the figures, by its label."""
    curves = frames.at_crank(frames.curves)
    return {label: curves[curves["sample"] == sample] for label, sample in frames.samples_drawn.items()}


def loop_spreads(frames: Frames, *columns: str) -> Mapping[str, pd.DataFrame] | None:
    """Spread over the samples on the two branches that span all torques, by column; None of a single sample.

    Angles count from the middle of each loop's width at zero torque.
    """
    if len(frames.band) < 2:
        return None
    steps = len(frames.of_band(frames.curves, "torque_Nm")[0])
    branch = np.asarray(frames.curves["branch"].iloc[:steps])
    torque = frames.curves["torque_Nm"].to_numpy()[:steps]
    spanning = (branch == "loading+") | (branch == "loading-")
    spreads = {}
    for name in columns:
        values = frames.of_band(frames.curves, name)
        values = centred_loops(values, branch, torque) if name == "angle_arcmin" else values
        spreads[name] = spread_frame(values[:, spanning], branch=branch[spanning], torque_Nm=torque[spanning])
    return spreads


CRANKS_PER_PITCH = 16
"""Crank angles within a pitch of the pins: between them their phases fill the lobe."""


def nominal_gaps(design: Design, crank_deg: float) -> pd.DataFrame:
    """Gaps of nominal pins at one crank angle by phase: phase_deg, exact_um, first_order_um."""
    reducer, profile = assembly.reducer(design, crank_deg), assembly.profile(design)
    nominal = Errors.zero(profile.pins, profile.lobes, len(reducer.contacts) - reducer.n_pins)
    gaps = {
        name: UM_PER_MM * method(profile, reducer, nominal, "radial")[0]
        for name, method in (("exact_um", exact_gaps), ("first_order_um", first_order_gaps))
    }
    return pd.DataFrame({"phase_deg": np.degrees(reducer.pins.phase), **gaps})


def nominal_gap_curve(design: Design) -> pd.DataFrame:
    """Gaps of nominal pins over the phase, ascending; columns as of ``nominal_gaps``."""
    cranks = 360 / design.cycloid.pins * np.arange(CRANKS_PER_PITCH) / CRANKS_PER_PITCH
    rows = pd.concat([nominal_gaps(design, float(crank)) for crank in cranks])
    return rows.sort_values("phase_deg", ignore_index=True)


def flank_fact(design: Design) -> str:
    """How the drawing modifies the flank; empty without a modification."""
    flank = design.flank
    if flank is None:
        return ""
    parts = {
        "equidistant {} µm": flank.equidistant_um,
        "moved distance {} µm": flank.moved_distance_um,
        "rotation {}′": flank.rotation_arcmin,
    }
    modifications = [text.format(plain_number(value)) for text, value in parts.items() if value]
    if flank.measured is not None:
        lobes = "each lobe" if len(flank.measured.deviation_um) > 1 else "one for all lobes"
        modifications.append(f"and a measured deviation at {flank.measured.points} points, {lobes}")
    return listed_text(modifications) if modifications else "as the pins generate it"
