"""The figures of a report: which rows each one draws, and what its caption says."""

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from pipeline import assembly
from pipeline.config.designs.design import Design
from pipeline.figures.labels import METRICS
from pipeline.figures.loads.clearances import pin_clearances_figure
from pipeline.figures.loads.hysteresis import bearing_figure, centred, hysteresis_figure
from pipeline.figures.loads.pins import dead_zones_figure, output_loads_figure, pin_loads_figure
from pipeline.figures.loads.springs import spring_laws_figure
from pipeline.figures.parts.flank import nominal_gap_figure
from pipeline.figures.parts.reducer import reducer_figure
from pipeline.figures.samples.distributions import crank_figure, distributions_figure
from pipeline.figures.samples.sensitivity import sensitivity_figure
from pipeline.figures.samples.units import units_figure
from pipeline.figures.spread import spread_frame
from pipeline.model.geometry.cycloid_profile import CycloidProfile, disk_rotation
from pipeline.report.drawing import Drawing
from pipeline.report.explorer.explorer import explored_units
from pipeline.report.flank import flank_fact, nominal_gap_curve, nominal_gaps
from pipeline.report.frames import HEADLINES, Frames
from pipeline.report.layout.wording import counted, plain
from pipeline.report.samples.section import sample_drawings
from pipeline.report.turn.drawings import turn_drawings

FLANK_POINTS_PER_LOBE = 48
"""Points of the drawn flank: its polygon is off by less than a line."""
RISING = (0.25, 0.5, 1.0)
"""Shares of the largest torque that join the lost-motion torque in the figures of growing torque."""


def drawings(frames: Frames) -> Iterator[Drawing]:
    """All figures that the frames have rows for, one after the other, so that each can be written and forgotten."""
    yield _reducer(frames)
    if frames.study.design.flank is not None:
        yield _flank(frames)
    yield _springs(frames)
    yield _clearances(frames)
    yield from _loads(frames)
    yield from _loops(frames)
    yield from turn_drawings(frames)
    if not frames.listed and len(frames.over_turn):
        yield _distributions(frames)
        yield from sample_drawings(frames)
        yield from _units(frames)
        holding = [metric for metric in HEADLINES if metric in _varying(frames)]
        if len(frames.study.cycle.crank_deg) > 1 and holding:
            yield _cranks(frames, holding)
        yield from _drivers(frames)


def flank_outline(design: Design, crank_deg: float) -> np.ndarray:
    """Closed outline of the disk in the housing frame (n_points,) [mm], x + iy; its points are equally far apart."""
    cycloid = design.cycloid
    profile = CycloidProfile(cycloid.pins, cycloid.pin_circle_radius_mm, cycloid.pin_radius_mm, cycloid.eccentricity_mm)
    crank = np.radians(crank_deg)
    fine = np.linspace(0, profile.lobe_pitch, 50 * FLANK_POINTS_PER_LOBE)
    length = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(profile.flank(fine))))])
    lobe = np.interp(np.linspace(0, length[-1], FLANK_POINTS_PER_LOBE, endpoint=False), length, fine)
    psi = np.append((lobe + profile.lobe_pitch * np.arange(profile.lobes)[:, None]).ravel(), 2 * np.pi)
    return profile.flank(psi) * np.exp(1j * disk_rotation(profile, crank)) + profile.eccentricity * np.exp(1j * crank)


def _first_disk(design: Design) -> str:
    """Which disk a figure shows, where there are several."""
    return ", disk 0 of several" if design.disk.count > 1 else ""


def _reducer(frames: Frames) -> Drawing:
    design, crank = frames.study.design, frames.crank_deg
    reducer, words = assembly.reducer(design, crank), design.output.words
    panels = [
        (panel, flank_outline(design, float(np.degrees(disk.crank))))
        for disk, numbers in zip(reducer.disks, reducer.output_rows, strict=True)
        for panel in design.output.panels(disk, reducer.contacts.some(numbers), numbers)
    ]
    return Drawing(
        "reducer",
        f"Numbers of pins and {words.contact}s",
        f"Pins are counted clockwise from the direction of the eccentric at crank angle 0. {words.drawing}",
        reducer_figure(
            frames.at_crank(frames.contacts),
            [outline for _, outline in panels] or [flank_outline(design, crank)],
            crank,
            design.cycloid.pin_radius_mm,
            [panel for panel, _ in panels],
        ),
    )


def _flank(frames: Frames) -> Drawing:
    design = frames.study.design
    measured = design.flank.measured if design.flank else None
    lobes_differ = measured is not None and len(measured.deviation_um) > 1
    return Drawing(
        "flank",
        "Gap of the drawn flank",
        f"What the drawn flank leaves to nominal pins before any take-up, {flank_fact(design)}; crank angle of the "
        f"pins {plain(frames.crank_deg)}°. First order fails at the roots, where the centre of curvature of the flank "
        "is close to the pin's.",
        nominal_gap_figure(nominal_gap_curve(design), nominal_gaps(design, frames.crank_deg), lobes_differ),
    )


def _springs(frames: Frames) -> Drawing:
    output = frames.study.design.output
    return Drawing(
        "spring_laws",
        "Spring laws",
        "Local deformation and tangent stiffness of single contacts, beyond their clearance. What the disk yields as a "
        "whole comes on top. Dashed: beyond the law's range its tangent goes on.",
        spring_laws_figure(
            frames.at_crank(frames.laws),
            frames.at_crank(frames.contacts),
            output.words.contact,
            output.words.bearing,
            output.words.rows,
        ),
    )


def _clearances(frames: Frames) -> Drawing:
    pins = frames.study.design.cycloid.pins
    gaps = frames.at_crank(frames.gaps)
    of_pins = gaps[gaps["contact"] < pins]
    traces = {label: of_pins[of_pins["sample"] == sample] for label, sample in frames.drawn.items()}
    spread = None
    if len(frames.band) > 1:
        spread = spread_frame(frames.of_band(frames.gaps, "clearance_um")[:, :pins], contact=np.arange(pins))
    return Drawing(
        "clearances",
        "Clearance between disk and pins",
        f"At crank angle {plain(frames.crank_deg)}°, before any load. Equal errors of the pins do not give equal "
        f"clearances. Negative values are interference.{_of_band(frames, spread)}",
        pin_clearances_figure(traces, spread),
    )


def _loads(frames: Frames) -> Iterator[Drawing]:
    """Forces on pins and rollers of the drawn samples whose contacts were kept."""
    selected = {
        label: rows
        for label, sample in frames.drawn.items()
        if len(rows := frames.at_crank(frames.loads[frames.loads["sample"] == sample]))
    }
    if not selected:
        return
    study, pins = frames.study, frames.study.design.cycloid.pins
    torques = _rising_torques(frames, next(iter(selected.values())))
    low, crank = torques[0], plain(frames.crank_deg)
    at_low = {label: _at_torque(rows, low) for label, rows in selected.items()}
    of_pins = {label: rows[rows["contact"] < pins] for label, rows in at_low.items()}
    yield Drawing(
        "dead_zones",
        f"Clearance and approach at {plain(low)} N m",
        f"At crank angle {crank}° and {plain(study.metrics.lost_motion_percent)} % of the rated torque. A pin carries "
        "load where the bodies approach each other by more than its clearance.",
        dead_zones_figure(of_pins),
    )
    contacts, of_disk = frames.at_crank(frames.contacts), _first_disk(study.design)
    if len(selected) > 1:
        traces, rising, condition = at_low, False, f"at {plain(low)} N m"
    else:
        ((label, rows),) = selected.items()
        traces = {f"{plain(torque)} N m": _at_torque(rows, torque) for torque in torques}
        rising, condition = True, f"of {frames.owner(label)} under growing torque"
    yield Drawing(
        "pin_loads",
        f"Contact forces and deformations of the pins {condition}",
        f"At crank angle {crank}°{of_disk}. The deformation is that of the contact and of the disk under it.",
        pin_loads_figure({name: rows[rows["contact"] < pins] for name, rows in traces.items()}, rising),
    )
    words = study.design.output.words
    if study.design.output.contacts == 0:
        return
    yield Drawing(
        "output_loads",
        f"Forces on the {words.contact}s {condition}",
        f"At crank angle {crank}°{of_disk}; {words.loads}",
        output_loads_figure(traces, contacts[contacts["disk"] <= 0], words.station, rising, words.rows),
    )


def _rising_torques(frames: Frames, rows: pd.DataFrame) -> list[float]:
    """The lost-motion torque and some larger ones that the load cycle visits, ascending [N m]."""
    state_torques = np.unique(rows["torque_Nm"].to_numpy())
    lost_motion = frames.study.design.cycloid.rated_torque_Nm * frames.study.metrics.lost_motion_percent / 100
    torques = [lost_motion, *(share * state_torques[-1] for share in RISING)]
    return sorted({float(state_torques[np.argmin(np.abs(state_torques - torque))]) for torque in torques})


def _at_torque(rows: pd.DataFrame, torque: float) -> pd.DataFrame:
    """Contacts at the first step of the cycle that has this torque."""
    return rows[rows["step"] == rows.loc[rows["torque_Nm"] == torque, "step"].min()]


def _loops(frames: Frames) -> Iterator[Drawing]:
    study, at_crank = frames.study, frames.at_crank(frames.curves)
    traces = {label: at_crank[at_crank["sample"] == sample] for label, sample in frames.drawn.items()}
    spreads = _loop_spreads(frames) if len(frames.band) > 1 else None
    marks = assembly.definitions(study)
    centre = " Each loop is drawn about the middle of its width at zero torque." if spreads else ""
    yield Drawing(
        "hysteresis",
        "Torsion angle against torque",
        f"At crank angle {plain(frames.crank_deg)}°, input held; marked are the definitions of the metrics. Without "
        "friction loading and unloading coincide outside the free play."
        f"{centre}{_of_band(frames, spreads)}",
        hysteresis_figure(traces, spreads["angle_arcmin"] if spreads else None, marks),
    )
    yield Drawing(
        "bearing",
        "Displacement of the disk" + ("" if study.design.output.carries_disks else " on the input bearing"),
        f"At crank angle {plain(frames.crank_deg)}°{_first_disk(study.design)}, in the housing's directions; the "
        f"eccentric points along {_direction(frames.crank_deg)}.{_of_band(frames, spreads)}",
        bearing_figure(traces, spreads),
    )


def _loop_spreads(frames: Frames) -> Mapping[str, pd.DataFrame]:
    """Spread of angle and bearing displacement over the samples, on the two branches that span all torques."""
    steps = len(frames.of_band(frames.curves, "torque_Nm")[0])
    branch = np.asarray(frames.curves["branch"].iloc[:steps])
    torque = frames.curves["torque_Nm"].to_numpy()[:steps]
    chosen = (branch == "loading+") | (branch == "loading-")
    values = {name: frames.of_band(frames.curves, name) for name in ("angle_arcmin", "bearing_x_um", "bearing_y_um")}
    values["angle_arcmin"] = centred(values["angle_arcmin"], branch, torque)
    return {
        name: spread_frame(value[:, chosen], branch=branch[chosen], torque_Nm=torque[chosen])
        for name, value in values.items()
    }


def _distributions(frames: Frames) -> Drawing:
    worst = frames.distributions[frames.distributions["over"] == frames.over]
    level = plain(100 * frames.study.metrics.confidence)
    return Drawing(
        "distributions",
        "Distributions of the metrics over the samples",
        f"{frames.over.capitalize()} value of each of {counted(len(frames.over_turn), 'sample')} over the turn. "
        f"Below each histogram: 5 % quantile, mean and 95 % quantile with their {level} % intervals; an arrowhead "
        "marks an end that the samples do not determine. Beyond the limit the ground is shaded.",
        distributions_figure(frames.over_turn[_varying(frames)], worst, frames.limits, _nominal(frames)),
    )


def _units(frames: Frames) -> Iterator[Drawing]:
    units = explored_units(frames)
    if len(units.columns) < 2:
        return
    pair = list(units.columns[:2])
    curves = frames.at_crank(frames.curves)
    angles = np.stack([curves.loc[curves["sample"] == sample, "angle_arcmin"].to_numpy() for sample in units.index])
    torque = curves["torque_Nm"].to_numpy()[: angles.shape[1]]
    yield Drawing(
        "units",
        "Single units",
        f"The first {counted(len(units), 'unit')}: their values over the turn, and their loops at crank angle "
        f"{plain(frames.crank_deg)}°. Point at a unit, or go from unit to unit with the arrow keys, to see its loop "
        "and the forces on its pins (filled points).",
        units_figure(pair, units[pair].to_numpy(), frames.limits, torque, angles),
    )


def _varying(frames: Frames) -> list[str]:
    """Metrics that hold for some sample."""
    return [name for name in frames.shown_metrics if frames.over_turn[name].notna().any()]


def _nominal(frames: Frames) -> dict[str, float]:
    return frames.turn_of(0) if frames.study.samples.nominal_first else {}


def _cranks(frames: Frames, metrics: list[str]) -> Drawing:
    by_crank = frames.distributions[frames.distributions["over"] == "angle"]
    return Drawing(
        "cranks",
        "The metrics over the turn of the crank",
        "Mean and band of 90 % of the samples at each loaded crank angle, and the nominal reducer. A unit's worst lies "
        "beyond the band of a single angle: it is the worst of them all.",
        crank_figure(by_crank, frames.nominal, metrics, frames.limits),
    )


def _drivers(frames: Frames) -> Iterator[Drawing]:
    table, level = frames.sensitivity, plain(100 * frames.study.metrics.confidence)
    for metric in frames.shown_metrics:
        of_metric = (table["metric"] == metric) & (table["over"] == "worst")
        rows = table[of_metric & np.isfinite(table["index"].to_numpy(float))]
        if len(rows):
            yield Drawing(
                f"drivers_{metric}",
                f"Which tolerance drives the {METRICS[metric].inline}",
                f"Worst over the turn. Lines: {level} % intervals. Empty bars, numbers in brackets: not determined, "
                "the interval is as wide as the index.",
                sensitivity_figure(rows),
            )


def _of_band(frames: Frames, spread: object) -> str:
    """Which samples the band is of."""
    if spread is None:
        return ""
    subset = frames.curves["sample"].iloc[-1] + 1 < frames.study.samples.rows
    return f" The band is over {'the first ' if subset else ''}{counted(len(frames.band), 'sample')}."


def _direction(crank_deg: float) -> str:
    names: dict[float, str] = {0.0: "+x", 90.0: "+y", 180.0: "−x", 270.0: "−y"}
    return names.get(crank_deg, f"{plain(crank_deg)}° from x, counterclockwise")
