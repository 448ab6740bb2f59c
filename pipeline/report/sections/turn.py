"""A loop under load and a whole turn: transmission error, forces on bearings and pins."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import assembly
from pipeline.config.studies.consistency import stated_needs
from pipeline.figures.hysteresis import hysteresis_figure, orders_figure, transmission_figure, turn_forces_figure
from pipeline.figures.labels import spread_frame
from pipeline.model.metrics.turn import FEWEST_ANGLES, NEEDS, TurnMetric, turn_library
from pipeline.model.metrics.turn.turn_metric import BALANCE, TURN
from pipeline.report.frames import Drawing, Frames, band_sentence, case_label, loop_spreads, loop_traces
from pipeline.report.layout import count_text, listed_text, number, percent, plain_number
from pipeline.report.results import STATISTICS, Cell, Results
from pipeline.report.sections.section import Section

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
    results: Results

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
        values = tuple(number(float(units[sample]), metric) for sample in self.shown_samples)
        estimates = () if self.frames.is_listed else self.results.estimate_cells(name)
        limit, share_within = self.results.limit(name), self.results.share(name, "yield")
        return TurnRow(metric.title, metric.unit, values, estimates, limit, share_within)

    @property
    def has_limits(self) -> bool:
        """Whether a metric of the turn has a limit and the samples are random."""
        return not self.frames.is_listed and any(name in self.frames.limits for name in turn_library())

    @property
    def corrected(self) -> str:
        """Which estimates are of the whole turn, and which numbers beside them are not; empty where none are."""
        titles = [m.inline for name, m in turn_library().items() if self.results.is_of_whole_turn(name, "mean")]
        if not titles:
            return ""
        counts = self.frames.units.iloc[0]
        return (
            f"The {' and the '.join(titles)} are of the whole turn: its pitches were searched for both ends of each "
            "angle, and units that were solved at every pitch correct statistics and yield for what the search misses. "
            f"Figures are of {int(counts['n_angles']):,} loaded and {int(counts['n_rigid_angles']):,} unloaded crank "
            "angles."
        )

    @cached_property
    def missing_needs(self) -> set[str]:
        """What the study or its design does not have, of ``NEEDS``."""
        has_rank = bool(self.told_apart)
        available = {TURN: has_rank, BALANCE: not has_rank or self._is_known("bearing_force_peak_N")}
        available |= stated_needs(self.frames.study.design.operation)
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


UNBALANCED_NOTE = " (not known of this reducer, see below)"
"""Said of forces on a bearing that do not balance the torque on the output."""
TILT = " That the offset of the disks' planes tilts them is not modelled: bearings carry more than this."
"""Said of several disks."""
MESH_ORDERS = 2
"""Orders about that of the pins that are drawn with the lowest."""


def turn_drawings(frames: Frames) -> Iterator[Drawing]:
    """All figures of the turn; none from fewer angles than tell anything of it."""
    if not frames.samples_drawn or len(frames.study.cycle.crank_deg) < FEWEST_ANGLES:
        return
    yield _transmission(frames)
    if not frames.is_listed and len(frames.orders):
        yield _orders(frames)
    yield _forces(frames)


def _panels(frames: Frames) -> dict[str, float]:
    """Torque [N m] of the two curves by their titles."""
    held_torque = assembly.definitions(frames.study).rigidity_high
    return {"Without load, at the end of the play": 0.0, f"{plain_number(held_torque)} N m held": held_torque}


def _spread(frames: Frames, rows: pd.DataFrame, column: str, is_centred: bool) -> pd.DataFrame | None:
    """Spread over the samples in the sense +, the nominal one left out; None of listed cases and of a single sample."""
    rows = rows[(rows["sense"] == "+") & (rows["sample"] >= frames.first_random)]
    table = rows.pivot(index="sample", columns="crank_deg", values=column).dropna()
    if frames.is_listed or len(table) < 2:
        return None
    values = table.to_numpy()
    shifted_values = values - values.mean(axis=1, keepdims=True) if is_centred else values
    return spread_frame(shifted_values, crank_deg=table.columns.to_numpy())


def _of_torque(rows: pd.DataFrame, torque: float) -> pd.DataFrame:
    return rows[np.abs(rows["torque_Nm"]) == torque]


def _transmission(frames: Frames) -> Drawing:
    label, sample = next(iter(frames.samples_drawn.items()))
    panels, spreads = {}, {}
    for title, torque in _panels(frames).items():
        rows = _of_torque(frames.transmission, torque)
        unit = rows[rows["sample"] == sample]
        mean = unit.groupby("sense", observed=True)["error_arcsec"].transform("mean")
        panels[title] = unit.assign(error_arcsec=unit["error_arcsec"] - mean)
        spread = _spread(frames, rows, "error_arcsec", is_centred=True)
        if spread is not None:
            spreads[title] = spread
    return Drawing(
        "transmission",
        f"Transmission error over a turn of the {frames.study.cycle.turn}",
        f"Angle of the output less that of the nominal ratio, about its mean: {frames.owner(label)} in both senses"
        f"{', and the spread of the samples in the sense +' if spreads else ''}.",
        partial(transmission_figure, panels, spreads),
    )


def _orders(frames: Frames) -> Drawing:
    pins, panels = frames.study.design.cycloid.pins, {}
    cycle, under_load = frames.study.cycle, bool((frames.orders["torque_Nm"] != 0).any())
    angles = len(cycle.crank_deg) if under_load else len(cycle.even_crank_deg)
    lowest = (angles - 1) // 2 // cycle.crank_turns
    folded_text = f" Orders beyond {lowest} fold back onto these" if under_load else ""
    for title, torque in _panels(frames).items():
        rows = _of_torque(frames.orders, torque)
        rows = rows[(rows["sample"] >= frames.first_random) & (rows["order"] <= lowest)]
        if len(rows):
            quantiles = rows.groupby("order")["amplitude_arcsec"].quantile([0.5, 0.95]).unstack()
            panels[title] = quantiles.set_axis(["middle", "high"], axis=1).reset_index()
    free_rows = _of_torque(frames.orders, 0.0)
    mesh = free_rows.loc[np.abs(free_rows["order"] - pins) <= MESH_ORDERS, "amplitude_arcsec"]
    at_pins = f" At the order of the {pins} pins the unloaded one has {mesh.median():.2g} arcsec." if len(mesh) else ""
    return Drawing(
        "orders",
        "Orders of the transmission error",
        f"Amplitude of the waves per turn of the crank, both senses.{at_pins}{folded_text}"
        f"{' under load, for the loaded angles do not distinguish them.' if folded_text else ''}",
        partial(orders_figure, panels),
    )


def _forces(frames: Frames) -> Drawing:
    label, sample = next(iter(frames.samples_drawn.items()))
    rows = frames.transmission[frames.transmission["torque_Nm"] != 0]
    spread = _spread(frames, rows, "bearing_force_N", is_centred=False)
    contacts = frames.turn_contacts[frames.turn_contacts["sample"] == sample]
    of_pin = []
    if len(contacts):
        pin = contacts[contacts["contact"] == contacts["contact"].min()]
        of_pin.append(pin.assign(sense=np.where(pin["torque_Nm"] > 0, "+", "-")))
    held_torque = plain_number(assembly.definitions(frames.study).rigidity_high)
    design = frames.study.design
    bearing, several = design.output.words.bearing, design.disk.count > 1 or design.output.carries_disks
    force = "largest force of a disk on any" if several else "force of the disk on the"
    return Drawing(
        "turn_forces",
        f"Forces over a turn of the {frames.study.cycle.turn}",
        f"{held_torque} N m held. Left: {force} {bearing}{_whose(frames, label, spread)}"
        f"{UNBALANCED_NOTE if frames.units['bearing_force_peak_N'].isna().all() else ''}."
        f"{TILT if frames.study.design.disk.count > 1 else ''} "
        f"Right: contact force of one pin of {frames.owner(label)}; "
        "it carries in one half of the crank's turn in each sense.",
        partial(turn_forces_figure, rows[rows["sample"] == sample], spread, of_pin, bearing),
    )


def _whose(frames: Frames, label: str, spread: pd.DataFrame | None) -> str:
    samples = frames.transmission["sample"].nunique() - int(frames.study.samples.nominal_first)
    band = f", and the spread of {count_text(samples, 'sample')}" if spread is not None else ""
    return f" of {frames.owner(label)}{band}"


def _curve_drawings(frames: Frames) -> Iterator[Drawing]:
    spreads = loop_spreads(frames, "angle_arcmin")
    centre = " Each loop is drawn about the middle of its width at zero torque." if spreads else ""
    yield Drawing(
        "hysteresis",
        "Torsion angle against torque",
        f"At crank angle {plain_number(frames.crank_deg)}°, input held; marked are the definitions of the metrics. "
        "Without friction loading and unloading coincide outside the free "
        f"play.{centre}{band_sentence(frames, spreads)}",
        partial(
            hysteresis_figure,
            loop_traces(frames),
            spreads["angle_arcmin"] if spreads else None,
            assembly.definitions(frames.study),
        ),
    )


CURVE = Section(
    name="curve",
    title="Torsion under load",
    rank=80,
    template='{% from "macros.html" import figure with context %}\n{{ figure("hysteresis") }}\n',
    drawings=_curve_drawings,
)


TURN_SECTION = Section(
    name="turn",
    title="Over a turn",
    rank=90,
    template=Path(__file__).with_suffix(".html"),
    values=lambda page: {"turn": TurnSection(page.frames, page.results), "statistics": list(STATISTICS.values())},
    drawings=turn_drawings,
)

SECTIONS = (CURVE, TURN_SECTION)
