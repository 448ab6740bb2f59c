"""The page that certifies one unit."""

from __future__ import annotations

import math
from pathlib import Path

from pipeline.decisions.certificate import BAND, Certificate, Compensated, limit_sentence
from pipeline.engine.store import write_atomic
from pipeline.figures.decisions import certificate_figure
from pipeline.figures.labels import METRICS, PARAMETERS
from pipeline.model.metrics.turn import turn_library
from pipeline.report.layout.rendering import drawn_picture, render
from pipeline.report.layout.wording import DASH, interval, rounded_number

TEMPLATE = "decisions/certificate.html"
PROBABLE = 0.5
"""Probability of meeting every limit below which a unit rather fails."""


def compensation_sentence(unit: Certificate, loop: Compensated | None) -> str:
    """How much of the angle error the compensation removes."""
    if loop is None:
        spread = float((unit.compensation["high_arcmin"] - unit.compensation["low_arcmin"]).median())
        return f"No loop of this unit was measured; the band of the table is {spread:.3g} arcmin wide in the median."
    return (
        f"On the measured loop the angle error is {loop.before_arcmin:.3g} arcmin (rms) before and "
        f"{loop.after_arcmin:.3g} arcmin after compensation ({loop.rows:,} rows)."
    )


def next_step(unit: Certificate) -> str:
    """What to do with the unit: use it where it probably meets its limits, else change what fails first."""
    if unit.meets_all is None or unit.meets_all.value >= PROBABLE:
        return "Load compensation.csv into the controller."
    chances = unit.metrics.dropna(subset=["probability"]).set_index("metric")["probability"]
    worst = {**METRICS, **turn_library()}[str(chances.idxmin())].inline
    return (
        f"Do not use the unit as it is: it probably fails, first on {worst} (met with a probability of "
        f"{100 * chances.min():.3g} %). Exchange a measured part."
    )


def write_certificate_page(unit: Certificate, loop: Compensated | None, folder: Path) -> None:
    """Write report.html and its figure into ``folder``."""
    quantities = {**METRICS, **turn_library()}
    loops = unit.loops
    figure = certificate_figure(loops.torque, loops.angle[:, 0], BAND, float(loops.crank_deg[0]))
    caption = "Lines: median of the units that the measured one may be. Bands: 95 % of them."
    page = render(
        TEMPLATE,
        label=unit.label,
        study=unit.study,
        measured=[PARAMETERS[name] for name in unit.measured_dimensions],
        sentences=[limit_sentence(unit), compensation_sentence(unit, loop)],
        next_step=next_step(unit),
        left=compensation_sentence(unit, loop),
        metrics=[
            {
                "title": quantities[row["metric"]].axis,
                "median": quantities[row["metric"]].text(row["median"]),
                "ends": interval(row["low"], row["high"], quantities[row["metric"]]),
                "limit": rounded_number(row["limit"]),
                "probability": f"{100 * row['probability']:.3g} %" if math.isfinite(row["probability"]) else DASH,
            }
            for row in unit.metrics.to_dict("records")
            if math.isfinite(row["limit"]) or row["high"] > row["low"]
        ],
        bounds=[(METRICS[b.metric].axis, b.quantity, rounded_number(b.value)) for b in unit.bounds],
        crank=float(loops.crank_deg[0]),
        pictures={"loop": drawn_picture(figure, "Predicted loop", caption, folder / "figures" / "loop")},
    )
    write_atomic(folder / "report.html", page.encode())
