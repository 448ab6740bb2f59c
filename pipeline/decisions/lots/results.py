"""What a comparison of measured lots with a study leaves behind: its tables, and a study file of each lot."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.config.changing import study_file
from pipeline.config.dimensions import dimension_library
from pipeline.config.studies.study import Study
from pipeline.decisions.fresh_units import Solve
from pipeline.decisions.lots.dimension_fit import DimensionFit, dimension_fit
from pipeline.decisions.lots.fitted_distribution import relative_bic
from pipeline.decisions.lots.lot_yield import LotYield, lot_yield, study_of_lot
from pipeline.decisions.lots.measured_lot import FEWEST_PARTS, MeasuredLot
from pipeline.decisions.run_comparison import DIFFERENCES, ComparedRun, differences
from pipeline.engine.store import write_tables
from pipeline.engine.table import Column, Table, interval_columns
from pipeline.errors import InputError
from pipeline.statistics.intervals import Estimate

NO_ESTIMATE = Estimate(np.nan, np.nan, np.nan, 0)


def _estimate_columns(name: str, unit: str, meaning: str) -> tuple[Column, ...]:
    return (
        Column(name, "float64", unit, f"{meaning}; null: not defined"),
        *interval_columns(unit, f"interval of {name}", f"{name}_"),
    )


FITS = Table(
    "fits",
    "lot, measured dimension",
    (
        Column("lot", "label", "", "lot"),
        Column("dimension", "label", "", "toleranced dimension"),
        Column("parts", "int32", "1", "parts with a value"),
        Column("n", "int32", "1", "values"),
        Column("distribution", "label", "", "kind of distribution with the smallest BIC"),
        Column("next_distribution", "label", "", "kind with the next smallest BIC"),
        Column(
            "next_bic", "float64", "1", "BIC of the next kind less that of the chosen one; null: no other kind fits"
        ),
        *_estimate_columns("mean_um", "um", "mean of the total deviation"),
        *_estimate_columns("std_um", "um", "standard deviation"),
        *_estimate_columns("correlation_length_mm", "mm", "correlation length of neighbours along the circle"),
        *_estimate_columns("cp", "1", "capability C_p against the drawing"),
        *_estimate_columns("cpk", "1", "capability C_pk against the drawing"),
        *_estimate_columns("drift_um", "um", "change of the mean from the first part to the last"),
        Column("drift_p_value", "float64", "1", "of Kendall's test of a drift; null: too few parts"),
    ),
)
OUTLIERS = Table(
    "outliers",
    "value that a normal lot would not hold",
    (
        Column("lot", "label", "", "lot"),
        Column("dimension", "label", "", "toleranced dimension"),
        Column("part", "label", "", "part"),
        Column("element", "int32", "1", "element of the part; 0 of a dimension without elements"),
        Column("value_um", "float64", "um", "total deviation"),
    ),
)
YIELDS = Table(
    "yields",
    "lot, limit, tolerances",
    (
        Column("lot", "label", "", "lot"),
        Column("metric", "label", "", "column of metrics; all_limits: all together"),
        Column("tolerances", "label", "", "drawn: of the study; made: of the lot"),
        Column("yield", "float64", "1", "share of fresh load-solved units within the limit"),
        *interval_columns("1"),
        Column("n", "int32", "1", "units"),
        Column("preloaded", "float64", "1", "share of these units whose gaps interfere at some crank angle"),
    ),
)
COSTS = Table(
    "costs",
    "lot, measured dimension",
    (
        Column("lot", "label", "", "lot"),
        Column("dimension", "label", "", "toleranced dimension"),
        Column("yield_at_target", "float64", "1", "yield of the lot with this dimension at the drawing's mean"),
        Column("gain", "float64", "1", "less the yield of the lot, on the same units"),
        *interval_columns("1", "confidence interval of the gain"),
    ),
)


@dataclass(frozen=True)
class LotFindings:
    """One lot against a study.

    Attributes
    ----------
    skipped_dimensions : measured dimensions without a fit, and why.
    """

    lot: MeasuredLot
    fits: tuple[DimensionFit, ...]
    skipped_dimensions: tuple[tuple[str, str], ...]
    outcome: LotYield


def lot_fits(study: Study, lot: MeasuredLot) -> tuple[tuple[DimensionFit, ...], tuple[tuple[str, str], ...]]:
    """The fits of a lot, and the dimensions that have none with the reason.

    Raises
    ------
    InputError
        If no dimension of the lot can be fitted.
    """
    fits, skipped_dimensions = [], []
    confidence, seed = study.metrics.confidence, study.samples.seed
    for name, values in lot.values.items():
        dimension, tolerance = dimension_library()[name], getattr(study.tolerances, name)
        fit = dimension_fit(dimension, lot.parts, values, tolerance, study.design, confidence, seed)
        if fit is None:
            skipped_dimensions.append((name, f"fewer than {FEWEST_PARTS} values, or all equal"))
        else:
            fits.append(fit)
    if not fits:
        raise InputError(f"{lot.name}: no dimension has {FEWEST_PARTS} different values; measure more parts")
    return tuple(fits), tuple(skipped_dimensions)


def lot_findings(study: Study, lot: MeasuredLot, solve: Solve, units: int, jobs: int) -> LotFindings:
    """Fits of a lot and the yield of a study made from it."""
    fits, skipped_dimensions = lot_fits(study, lot)
    return LotFindings(lot, fits, skipped_dimensions, lot_yield(study, fits, solve, units, jobs))


def fit_rows(findings: Sequence[LotFindings]) -> pd.DataFrame:
    """Rows of `FITS`."""
    rows = []
    for lot_result in findings:
        for fit in lot_result.fits:
            relative_gaps = {name: gap for name, gap in relative_bic(fit.kinds).items() if gap > 0}
            following = min(relative_gaps.items(), key=lambda item: item[1], default=("", np.nan))
            drift = fit.drift
            estimates = {
                "mean_um": fit.mean,
                "std_um": fit.spread,
                "correlation_length_mm": fit.correlation_mm,
                "cp": fit.cp,
                "cpk": fit.cpk,
                "drift_um": drift.change_um if drift else None,
            }
            row: dict[str, Any] = {
                "lot": lot_result.lot.name,
                "dimension": fit.dimension.name,
                "parts": len(fit.values),
                "n": fit.values.size,
                "distribution": fit.tolerance.name,
                "next_distribution": following[0],
                "next_bic": following[1],
                "drift_p_value": drift.p_value if drift else np.nan,
            }
            for name, estimate in estimates.items():
                known_estimate = estimate or NO_ESTIMATE
                ends = {f"{name}_ci_low": known_estimate.ci_low, f"{name}_ci_high": known_estimate.ci_high}
                row |= {name: known_estimate.value, **ends}
            rows.append(row)
    return FITS.frame(rows)


def outlier_rows(findings: Sequence[LotFindings]) -> pd.DataFrame:
    """Rows of `OUTLIERS`."""
    rows = [
        (lot_result.lot.name, fit.dimension.name, fit.parts[part], element, fit.values[part, element])
        for lot_result in findings
        for fit in lot_result.fits
        for part, element in fit.outliers
    ]
    return OUTLIERS.frame(rows)


def yield_rows(findings: Sequence[LotFindings]) -> pd.DataFrame:
    """Rows of `YIELDS`."""
    rows = [
        (lot_result.lot.name, metric, tolerances, share.value, share.ci_low, share.ci_high, share.n, preload)
        for lot_result in findings
        for tolerances, shares, preload in (
            ("drawn", lot_result.outcome.as_drawn, lot_result.outcome.drawn_preload),
            ("made", lot_result.outcome.as_made, lot_result.outcome.made_preload),
        )
        for metric, share in shares.items()
    ]
    return YIELDS.frame(rows)


def cost_rows(findings: Sequence[LotFindings]) -> pd.DataFrame:
    """Rows of `COSTS`."""
    rows = [
        (lot_result.lot.name, cost.name, cost.yield_at_target, cost.gain.value, cost.gain.ci_low, cost.gain.ci_high)
        for lot_result in findings
        for cost in lot_result.outcome.costs
    ]
    return COSTS.frame(rows)


def lot_differences(study: Study, findings: Sequence[LotFindings]) -> pd.DataFrame:
    """Rows of `DIFFERENCES`: metrics and yields of units made from the second lot less those of the first."""
    runs = []
    for lot_result in findings:
        drawn_study = study_of_lot(study, lot_result.fits).with_section("samples", nominal_first=False)
        lot_study = drawn_study.model_copy(update={"name": lot_result.lot.name})
        runs.append(ComparedRun(lot_study, pd.DataFrame(dict(lot_result.outcome.values)), pd.DataFrame()))
    return pd.DataFrame(differences(*runs))


def study_text(study: Study, fits: Sequence[DimensionFit], lot: str, name: str, design: str) -> str:
    """The study with the distributions of a lot as a TOML file; ``design`` names its design."""
    title = f"{study.title or study.name}: parts of {lot}"
    comment = f"# {study.name} with distributions fitted to the measured parts of {lot}.\n"
    comment += f"# Its design is {design} in the folder of this file: move or copy both together.\n"
    return comment + study_file(study_of_lot(study, fits), name, design, {"title": title})


def write(study: Study, findings: Sequence[LotFindings], folder: Path) -> dict[str, pd.DataFrame]:
    """Write all tables as CSV and Parquet into ``folder``; their frames by name, of two lots also the differences."""
    tables = {FITS: fit_rows(findings), OUTLIERS: outlier_rows(findings), YIELDS: yield_rows(findings)}
    tables[COSTS] = cost_rows(findings)
    if len(findings) == 2:
        tables[DIFFERENCES] = lot_differences(study, findings)
    return write_tables(tables, folder, as_csv=True)
