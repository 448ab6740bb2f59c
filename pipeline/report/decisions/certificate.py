"""Pages on measured parts: the certificate of a unit, and which parts to assemble."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.config.studies.study import Study
from pipeline.decisions.certificate import BAND, Certificate, Compensated, limit_sentence, margin_text
from pipeline.decisions.selective_assembly import DRAWS, Assembly, pair_rows
from pipeline.engine.store import write_atomic
from pipeline.figures.decisions import certificate_figure, margins_figure
from pipeline.figures.labels import METRICS, PARAMETERS
from pipeline.model.metrics.turn import turn_library
from pipeline.report.decisions.lots import CHECK_VALUES, zone_warnings
from pipeline.report.layout import DASH, drawn_picture, interval, render, rounded_number
from pipeline.report.results import preload_warnings
from pipeline.statistics.intervals import Estimate

PROBABLE = 0.5
"""Probability of meeting every limit below which a unit rather fails."""


def compensation_sentence(unit: Certificate, loop: Compensated | None) -> str:
    """How much of the angle error the compensation removes."""
    if not unit.is_predicted:
        return "There is no compensation table: the model is valid for none of the units that this one may be."
    if loop is None and unit.is_determined:
        return "No loop of this unit was measured; nothing was drawn, so the table has no band."
    if loop is None:
        spread = float((unit.compensation["high_arcmin"] - unit.compensation["low_arcmin"]).median())
        return f"No loop of this unit was measured; the band of the table is {spread:.3g} arcmin wide in the median."
    return (
        f"On the measured loop the angle error is {loop.before_arcmin:.3g} arcmin (rms) before and "
        f"{loop.after_arcmin:.3g} arcmin after compensation ({loop.rows:,} rows)."
    )


def certificate_warnings(unit: Certificate) -> list[str]:
    """Which measured dimensions are in doubt, and that parts interfere."""
    preload = {"the units that the measured one may be": unit.preloaded}
    return [*zone_warnings(unit.study, unit.label, unit.measured_um), *preload_warnings(preload, CHECK_VALUES)]


def unit_next_step(unit: Certificate) -> str:
    """What to do with the unit: use it where it probably meets its limits, else change what fails first."""
    if not unit.is_predicted:
        return "Do not use the unit as it is: no draw is within the model's range of validity. Check the dimensions."
    if unit.meets_all is None or unit.meets_all.value >= PROBABLE:
        return (
            "Load compensation.csv into the controller, for the crank angles of the table: "
            "in other turns of the crank other lobes meet the pins."
        )
    chances = unit.metrics.dropna(subset=["probability"]).set_index("metric")["probability"]
    if not len(chances):
        return "Do not use the unit as it is: a metric that has a limit has no value. Check the dimensions."
    worst = {**METRICS, **turn_library()}[str(chances.idxmin())].inline
    if unit.is_determined:
        return f"Do not use the unit as it is: it misses the limit of the {worst}. Exchange a measured part."
    return (
        f"Do not use the unit as it is: it probably fails, first on {worst} (met with a probability of "
        f"{100 * chances.min():.3g} %). Exchange a measured part."
    )


def write_certificate_page(unit: Certificate, loop: Compensated | None, folder: Path) -> None:
    """Write report.html and its figure into ``folder``."""
    quantities = {**METRICS, **turn_library()}
    loops, pictures = unit.loops, {}
    if unit.is_predicted:
        figure = certificate_figure(loops.torque, loops.angle[:, 0], BAND, float(loops.crank_deg[0]))
        caption = (
            "Lines: the unit; nothing was drawn, so there is no band."
            if unit.is_determined
            else "Lines: median of the units that the measured one may be. Bands: 95 % of them."
        )
        pictures = {"loop": drawn_picture(figure, "Predicted loop", caption, folder / "figures" / "loop")}
    page = render(
        "decisions/certificate.html",
        label=unit.label,
        study=unit.study,
        warnings=certificate_warnings(unit),
        measured=[PARAMETERS[name] for name in unit.measured_dimensions],
        sentences=[limit_sentence(unit), compensation_sentence(unit, loop)],
        next_step=unit_next_step(unit),
        left=compensation_sentence(unit, loop),
        metrics=[
            {
                "title": quantities[row["metric"]].axis,
                "median": quantities[row["metric"]].text(row["median"]),
                "ends": "" if unit.is_determined else interval(row["low"], row["high"], quantities[row["metric"]]),
                "limit": rounded_number(row["limit"]),
                "probability": _limit_cell(unit, row),
            }
            for row in unit.metrics.to_dict("records")
            if math.isfinite(row["limit"]) or row["high"] > row["low"] or unit.is_determined
        ],
        bounds=[(METRICS[b.metric].axis, b.quantity, rounded_number(b.value)) for b in unit.bounds],
        why_no_bounds=unit.why_no_bounds,
        crank=float(loops.crank_deg[0]),
        is_predicted=unit.is_predicted,
        is_determined=unit.is_determined,
        gauge=f"{unit.measured_to_um:g}" if unit.measured_to_um else "",
        pictures=pictures,
    )
    write_atomic(folder / "report.html", page.encode())


def _limit_cell(unit: Certificate, row: dict[Any, Any]) -> str:
    """The probability that a metric meets its limit, of a determined unit whether it does and by how much."""
    if not math.isfinite(row["probability"]):
        return DASH
    if unit.is_determined:
        return margin_text({**METRICS, **turn_library()}[row["metric"]], row["median"], row["limit"]).split(", ")[1]
    return f"{100 * row['probability']:.3g} %"


SHOWN_PAIRS = 30
"""Pairs of the page, those with the smallest margins."""


def is_difference_shown(assembly: Assembly) -> bool:
    """Whether the intervals of the two yields do not overlap."""
    chosen, random = assembly.selected_yield, assembly.random
    return chosen.ci_low > random.ci_high or random.ci_low > chosen.ci_high


def pairs_next_step(assembly: Assembly) -> str:
    """What to do with the assignment."""
    if assembly.selected_yield.value > assembly.random.value and is_difference_shown(assembly):
        return "Assemble the pairs of pairs.csv, and measure the units of the pairs with the smallest margins."
    return (
        "Assemble at random, or measure more dimensions of the parts, those with the largest share of the variance "
        "first, and repeat the command."
    )


def assembly_warnings(study: Study, assembly: Assembly) -> list[str]:
    """Which measured dimensions are in doubt, and that parts interfere."""
    preload = {
        "the units of the assignment": assembly.selected_preload,
        "those assembled at random": assembly.random_preload,
    }
    doubts = [
        text for lot in (assembly.first_lot, assembly.second_lot) for text in zone_warnings(study, lot.name, lot.values)
    ]
    return [*doubts, *preload_warnings(preload, CHECK_VALUES)]


def assembly_sentences(assembly: Assembly, mounting_limit: float | None) -> list[str]:
    """Yields of the assignment and of random assembly, whether they differ, and how many pairs bind."""
    gain = f"{rounded_number(100 * (assembly.selected_yield.value - assembly.random.value))} percentage points"
    texts = [
        f"The assignment gives a yield of {_percent(assembly.selected_yield)}, random assembly "
        f"{_percent(assembly.random)}. "
        + (
            f"The difference is {gain}."
            if is_difference_shown(assembly)
            else f"The intervals overlap, so the difference ({gain}) is not shown."
        )
    ]
    if mounting_limit is not None:
        texts.append(
            f"{100 * assembly.binding_share(mounting_limit):.3g} % of all combinations bind: their contacts are "
            f"pressed by more than {mounting_limit:g} N without torque."
        )
    return texts


def _percent(share: Estimate) -> str:
    return f"{100 * share.value:.3g} % (interval {100 * share.ci_low:.3g} to {100 * share.ci_high:.3g})"


def write_assembly_page(study: Study, assembly: Assembly, mounting_limit: float | None, folder: Path) -> None:
    """Write report.html and its figure into ``folder``."""
    rows = pair_rows(assembly)
    table_rows = [
        {
            "first": row.first,
            "second": row.second,
            "margin": f"{rounded_number(100 * row.margin)} %" if np.isfinite(row.margin) else "no equilibrium",
            "passes": row.passes,
            "force": f"{row.mounting_force_N:.3g}",
        }
        for row in rows.head(SHOWN_PAIRS).itertuples()
    ]
    caption = "Shares of units below each predicted margin. Units below zero miss a limit."
    selected_margins = assembly.margin[tuple(assembly.pairs.T)]
    figure = margins_figure({"all combinations": assembly.margin.ravel(), "assignment": selected_margins})
    page = render(
        "decisions/assembly.html",
        study=study,
        first=assembly.first_lot.name,
        second=assembly.second_lot.name,
        warnings=assembly_warnings(study, assembly),
        sentences=assembly_sentences(assembly, mounting_limit),
        next_step=pairs_next_step(assembly),
        draws=DRAWS,
        yields=[
            {
                "title": title,
                "yield": f"{100 * share.value:.3g} %",
                "ends": f"{100 * share.ci_low:.3g} to {100 * share.ci_high:.3g} %",
                "units": f"{share.n:,}",
            }
            for title, share in (("at random", assembly.random), ("by the assignment", assembly.selected_yield))
        ],
        pairs=table_rows,
        n_pairs=len(rows),
        with_forces=mounting_limit is not None,
        pictures={"margins": drawn_picture(figure, "Predicted margins", caption, folder / "figures" / "margins")},
    )
    write_atomic(folder / "report.html", page.encode())
