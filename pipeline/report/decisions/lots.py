"""The page on measured lots against a study."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.arrays import Real
from pipeline.config.studies.study import ALL_LIMITS, Study
from pipeline.decisions.lots.measured_lot import FEWEST_PARTS, MeasuredLot
from pipeline.decisions.lots.results import LotFindings, cost_rows, fit_rows, lot_differences, outlier_rows, yield_rows
from pipeline.engine.store import write_atomic
from pipeline.figures.decisions import lots_figure
from pipeline.figures.labels import METRICS, PARAMETERS
from pipeline.report.layout import drawn_picture, listed_text, render, rounded_number
from pipeline.report.results import preload_warnings

DRIFT_LEVEL = 0.05
"""Familywise level of the drifts that the page names, over all dimensions of a lot (Bonferroni)."""


LEAST_SIZE = 0.01
"""Of deviations in widths of the drawing's zone: smaller ones are in another unit, or have a C_p above 16."""
OTHER_READINGS = {
    -1.0: "With the opposite sign they would fit: check the sign (python -m pipeline keys tolerances).",
    1e3: "Times 1000 they would fit: are they in mm? They are read in µm.",
    1e-3: "Divided by 1000 they would fit: are they in nm? They are read in µm.",
}
"""What may be wrong with measured values, by the factor that would put them right."""
CHECK_VALUES = "Check the sign and the unit of the measured values."
"""What to do where measured parts make preloaded units."""


def zone_warnings(study: Study, label: str, values: Mapping[str, Real]) -> list[str]:
    """Which measured values cannot be meant as they are read, by the zones of the drawing.

    Parameters
    ----------
    label : of the parts.
    values : total deviations [um] of any shape by dimension, NaN where one was not measured.
    """
    texts = []
    for name, drawing in study.tolerances:
        known = values[name][np.isfinite(values[name])] if name in values else np.empty(0)
        if not drawing.varies or not known.size:
            continue
        zone = tuple(drawing.allowance_um + limit for limit in drawing.limits_um)
        mean, spread, width = float(np.mean(known)), float(np.std(known)), zone[1] - zone[0]
        readings = [
            text for factor, text in OTHER_READINGS.items() if _fits_zone(factor * mean, abs(factor) * spread, zone)
        ]
        if not readings and drawing.allowance_um and _fits_zone(mean + drawing.allowance_um, spread, zone):
            readings.append(f"With the allowance of {drawing.allowance_um:g} µm they would fit: it is part of them.")
        which = f"Warning: {label}: {PARAMETERS[name]}: the"
        beside = f"the drawing's zone, {zone[0]:g} to {zone[1]:g} µm"
        if not zone[0] - width <= mean <= zone[1] + width:
            advice = " ".join(readings) or "Are they deviations from the nominal size in µm?"
            texts.append(
                f"{which} values have a mean of {mean:.4g} µm, more than its width outside of {beside}. {advice}"
            )
        elif spread < LEAST_SIZE * width and known.size >= FEWEST_PARTS and OTHER_READINGS[1e3] in readings:
            texts.append(
                f"{which} values have a standard deviation of {spread:.2g} µm, less than a hundredth of {beside}. "
                f"{OTHER_READINGS[1e3]}"
            )
    return texts


def _fits_zone(mean: float, spread: float, zone: Sequence[float]) -> bool:
    """Whether values are of the size of a zone [um], and their mean lies at most its width outside."""
    width = zone[1] - zone[0]
    is_near = zone[0] - width <= mean <= zone[1] + width
    return is_near and spread <= width and LEAST_SIZE * width <= np.hypot(mean, spread)


def lot_warnings(study: Study, lot_result: LotFindings) -> list[str]:
    """Which measured values are in doubt, and that parts of units made from them interfere."""
    preload = {
        f"the units made from the parts of {lot_result.lot.name}": lot_result.outcome.made_preload,
        "those with the tolerances of the study": lot_result.outcome.drawn_preload,
    }
    return [*zone_warnings(study, lot_result.lot.name, lot_result.lot.values), *preload_warnings(preload, CHECK_VALUES)]


def sentences(lot_result: LotFindings) -> list[str]:
    """The yield of a lot, what costs most of it, and what to do next."""
    made_yield, drawn_yield = lot_result.outcome.as_made[ALL_LIMITS], lot_result.outcome.as_drawn[ALL_LIMITS]
    text = (
        f"Lot {lot_result.lot.name}: {_percent(made_yield.value)} of units made from these parts meet every limit "
        f"(interval {_percent(made_yield.ci_low)} to {_percent(made_yield.ci_high)}); with the tolerances of the study "
        f"it is {_percent(drawn_yield.value)}."
    )
    costly = [cost for cost in lot_result.outcome.costs if cost.gain.ci_low > 0]
    if not costly:
        text_of_costs = "No measured dimension by itself costs yield beyond the confidence interval."
        return [text, text_of_costs, *single_value_sentences(lot_result)]
    first_cost = costly[0]
    return [
        text,
        f"{PARAMETERS[first_cost.name].capitalize()} costs most yield: at the drawing's mean in every part the yield "
        f"would be {_percent(first_cost.yield_at_target)} ({_points(first_cost.gain.value)} percentage points more, "
        f"interval {_points(first_cost.gain.ci_low)} to {_points(first_cost.gain.ci_high)}).",
        *single_value_sentences(lot_result),
    ]


def single_value_sentences(lot_result: LotFindings) -> list[str]:
    """What one value per part is taken for, of each dimension that the elements of a part have one by one."""
    texts = []
    for fit in lot_result.fits:
        elements, name = fit.dimension.elements, fit.dimension.name
        if elements is None or fit.values.shape[1] > 1:
            continue
        element = elements.name.replace("_", " ")
        texts.append(
            f"Lot {lot_result.lot.name}: {name} has one value per part. Each is taken for one {element} by itself, and "
            f"every {element} of a unit is drawn from their scatter, independently of the others. If a value is the "
            f"mean of several {element}s, the yield does not hold: give each {element} a value ({name}_0, {name}_1, "
            f"..., or one row per {element} with the same part)."
        )
    return texts


def remarks(lot_result: LotFindings) -> list[str]:
    """Drifts, outliers, dimensions without a fit, and columns that were not used."""
    texts, lot = [], lot_result.lot.name
    for fit in lot_result.fits:
        if fit.drift and fit.drift.p_value < DRIFT_LEVEL / len(lot_result.fits):
            texts.append(
                f"{lot}: {PARAMETERS[fit.dimension.name]} drifts over the order of production by "
                f"{fit.drift.change_um.value:.3g} µm (p = {fit.drift.p_value:.2g})."
            )
    rows = outlier_rows([lot_result])
    if len(rows):
        part_names = [
            f"part {str(row.part).removesuffix('.0')} ({PARAMETERS[row.dimension]}, {row.value_um:.3g} µm)"
            for row in rows.itertuples()
        ]
        texts.append(
            f"{lot}: values farther out than in 95 % of the lots that the fit gives: {listed_text(part_names[:10])}. "
            "They are kept in the fits. Skewed lots, which no kind fits, have such values often."
        )
    texts += [f"{lot}: {PARAMETERS[name]} is not fitted: {reason}." for name, reason in lot_result.skipped_dimensions]
    return [*texts, *unused_columns(lot_result.lot)]


def unused_columns(lot: MeasuredLot) -> list[str]:
    """The columns of a table of parts that were not used, in a sentence; none where all were."""
    names = listed_text(lot.ignored_columns)
    what = "columns that are no toleranced dimension and were not used"
    return [f"{lot.name}: {what}: {names}."] if lot.ignored_columns else []


def write_lots_page(study: Study, findings: Sequence[LotFindings], files: Sequence[str], folder: Path) -> None:
    """Write report.html and its figure into ``folder``; ``files`` name the study files beside it."""
    dimensions = {fit.dimension.name: getattr(study.tolerances, fit.dimension.name) for f in findings for fit in f.fits}
    fits = [(lot_result.lot.name, fit) for lot_result in findings for fit in lot_result.fits]
    panels = []
    for name, drawing in dimensions.items():
        lots = [(lot, fit.values.ravel(), fit.tolerance) for lot, fit in fits if fit.dimension.name == name]
        panels.append((name, lots, drawing))
    caption = "Steps: measured parts. Dashed: fitted distribution. Dotted: limits of the drawing."
    page = render(
        "decisions/lots.html",
        study=study,
        warnings=[text for lot_result in findings for text in lot_warnings(study, lot_result)],
        sentences=[text for lot_result in findings for text in sentences(lot_result)],
        files=files,
        units=findings[0].outcome.as_made[ALL_LIMITS].n,
        yields=_yields(yield_rows(findings)),
        costs=[_cost(row) for row in cost_rows(findings).to_dict("records")],
        fits=[_fit(row) for row in fit_rows(findings).to_dict("records")],
        remarks=[text for lot_result in findings for text in remarks(lot_result)],
        differences=_differences(study, findings) if len(findings) == 2 else None,
        pictures={
            "lots": drawn_picture(
                lots_figure(panels), "Measured deviations and fits", caption, folder / "figures" / "lots"
            )
        },
    )
    write_atomic(folder / "report.html", page.encode())


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"


def _points(share: float) -> str:
    return rounded_number(100 * share)


def _title(metric: str) -> str:
    return "All limits" if metric == ALL_LIMITS else METRICS[metric].title


def _yields(table: pd.DataFrame) -> list[dict[str, str]]:
    rows = []
    for (lot, metric), part in table.groupby(["lot", "metric"], sort=False):
        made_row, drawn_row = (part[part["tolerances"] == kind].iloc[0] for kind in ("made", "drawn"))
        ends = [f"{_percent(row['ci_low'])} to {_percent(row['ci_high'])}" for row in (made_row, drawn_row)]
        values = {"made": _percent(made_row["yield"]), "drawn": _percent(drawn_row["yield"])}
        rows.append({"lot": lot, "title": _title(metric), **values, "made_ends": ends[0], "drawn_ends": ends[1]})
    return rows


def _cost(row: dict[str, Any]) -> dict[str, str]:
    return {
        "lot": row["lot"],
        "title": PARAMETERS[row["dimension"]],
        "gain": _points(row["gain"]),
        "ends": f"{_points(row['ci_low'])} to {_points(row['ci_high'])}",
        "yield": _percent(row["yield_at_target"]),
    }


def _fit(row: dict[str, Any]) -> dict[str, object]:
    cells: dict[str, object] = {
        "lot": row["lot"],
        "title": PARAMETERS[row["dimension"]],
        "parts": row["parts"],
        "kind": row["distribution"].replace("_", " "),
    }
    short = {"mean_um": "mean", "std_um": "std", "cp": "cp", "cpk": "cpk", "drift_um": "drift"}
    for name, key in {**short, "correlation_length_mm": "length"}.items():
        is_known = math.isfinite(row[name])
        cells[key], *ends = (rounded_number(row[column]) for column in (name, f"{name}_ci_low", f"{name}_ci_high"))
        cells[f"{key}_ends"] = " to ".join(ends) if is_known else ""
    return cells


def _differences(study: Study, findings: Sequence[LotFindings]) -> dict[str, object]:
    rows = lot_differences(study, findings)
    rows = rows[rows["statistic"].isin(["mean", "std", "yield"])]
    return {
        "a": findings[0].lot.name,
        "b": findings[1].lot.name,
        "rows": [
            {
                "title": _title(row["metric"]),
                "statistic": {"std": "standard deviation"}.get(row["statistic"], row["statistic"]),
                "ends": f"{rounded_number(row['ci_low'])} to {rounded_number(row['ci_high'])}",
                **{key: rounded_number(row[key]) for key in ("a", "b", "difference")},
            }
            for row in rows.to_dict("records")
        ],
    }
