"""Tables of an identification: the residual cell by cell, its signatures, and every effect that was tried or not."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from typing import Any

import numpy as np

from pipeline.arrays import Real, Truth
from pipeline.engine.table import Column, Columns, Table, interval_columns
from pipeline.identification.fitting.data import Data
from pipeline.identification.fitting.parameters import Fit
from pipeline.identification.identify import Identification
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.results.residual_signatures import Signature
from pipeline.identification.selection.criteria import NAMED_ODDS
from pipeline.identification.selection.statements.statement import title_of

STAGE_TITLES = {
    "declared": "the model as declared",
    "recalibrated": "its calibrated numbers refitted",
    "after": "the chosen model",
}


def cell_columns(titles: Mapping[str, str]) -> tuple[Column, ...]:
    """Columns of a table of cells, with the predictions of some models by name and title."""
    return (
        Column("position", "int32", "1", "number of the crank position"),
        Column("crank_deg", "float64", "deg", "crank angle"),
        Column("cycle", "int32", "1", "load cycle"),
        Column("block", "int32", "1", "position x cycle x monotone branch"),
        Column("direction", "int32", "1", "+1 where the torque rises, -1 where it falls"),
        Column("time_s", "float64", "s", "mean time of the rows; null where not measured"),
        Column("temperature_C", "float64", "deg C", "mean temperature of the rows; null where not measured"),
        Column("torque_Nm", "float64", "N m", "mean torque of the rows"),
        Column("angle_arcmin", "float64", "arcmin", "mean angle of the rows"),
        Column("rows", "int32", "1", "rows in the cell"),
        Column("sigma_arcmin", "float64", "arcmin", "noise of the cell: floor, torque noise times slope, jumps"),
        Column("held_out", "bool", "", "whether the cell judges; its predictions then come from fits without it"),
        *(
            Column(f"{name}_arcmin", "float64", "arcmin", f"angle by {title}, offset included")
            for name, title in titles.items()
        ),
        *(
            Column(f"residual_{name}_arcmin", "float64", "arcmin", f"measured less {title}")
            for name, title in titles.items()
        ),
    )


RESIDUAL = Table(
    "residual",
    "cell: measured rows averaged over neighbouring torques of one branch",
    (
        *cell_columns(STAGE_TITLES),
        Column(
            "written_arcmin",
            "float64",
            "arcmin",
            "angle by the written study on this load history, offset included; null where none is written",
        ),
    ),
)
SIGNATURES = Table(
    "signatures",
    "signature of the residual, before (recalibrated) and after (chosen model)",
    (
        Column("of", "label", "", "recalibrated or after"),
        Column("signature", "label", "", "name"),
        Column("title", "label", "", "what the residual depends on"),
        Column("unit", "label", "", "of value and interval"),
        Column("value", "float64", "see unit", "coefficient; null: not testable"),
        *interval_columns("see unit", "95 % interval of the block bootstrap"),
        Column("p", "float64", "1", "of no dependence, each signature by itself"),
        Column("significant", "bool", "", "whether p is below 5 %"),
        Column("why_not", "label", "", "why the data cannot test it; empty if they can"),
    ),
)
CANDIDATES = Table(
    "candidates",
    "effect that was tried or cannot be tested, and sets of effects",
    (
        Column("effect", "label", "", "name in the library; + joins effects that act together"),
        Column("title", "label", "", "what it is"),
        Column("parameters", "label", "", "fitted parameters as JSON; empty where it was not fitted in full"),
        Column("misfit_before", "float64", "1", "root mean square misfit of the recalibrated model in noise"),
        Column("misfit_after", "float64", "1", "the same with the effect"),
        Column("log_odds", "float64", "1", "logarithm of the posterior odds against no effect; null: only describes"),
        Column("log_score_gain", "float64", "1", "gain in the log predictive density of data left out"),
        Column("significant", "bool", "", "whether the odds against no effect are 999 to 1"),
        Column("member_of_class", "bool", "", "whether it is among those that the verdict names"),
        Column("screened_share", "float64", "1", "least misfit on a coarse grid, in shares of the recalibrated one"),
        Column("why_not", "label", "", "why it was not tested, not fitted in full, or supports no claim; else empty"),
    ),
)
NOT_SOLVED = "no equilibrium was found where it was tried"


def residual_rows(identification: Identification, study_angle: Real | None) -> Columns:
    """Columns of `RESIDUAL`; ``study_angle`` is the angle (n_cells,) [arcmin] of the written study, if there is one."""
    data, folds = identification.problem.data, identification.folds
    return {
        **values_of_cells(identification.measurement, data, folds.cells, identification.curves),
        "written_arcmin": np.full(len(data), np.nan) if study_angle is None else study_angle,
    }


def values_of_cells(measurement: Measurement, data: Data, is_judged: Truth, curves: Mapping[str, Real]) -> Columns:
    """Values of ``cell_columns``, of cells (n_cells,) some of which judge, and of predictions (n_cells,) [arcmin]."""
    cells = measurement.cells
    return {
        "position": cells.position,
        "crank_deg": measurement.rows.cranks[cells.position],
        "cycle": cells.cycle,
        "block": cells.block,
        "direction": cells.direction,
        "time_s": cells.time_mean,
        "temperature_C": cells.temperature_mean,
        "torque_Nm": data.torque,
        "angle_arcmin": data.angle,
        "rows": data.count,
        "sigma_arcmin": data.sigma,
        "held_out": is_judged,
        **{f"{name}_arcmin": angle for name, angle in curves.items()},
        **{f"residual_{name}_arcmin": data.angle - angle for name, angle in curves.items()},
    }


def signature_rows(signatures_of_stage: Mapping[str, Sequence[Signature]]) -> Columns:
    """Columns of `SIGNATURES`, by what the residual is of."""
    rows = [(stage, *astuple(signature)) for stage, of_stage in signatures_of_stage.items() for signature in of_stage]
    return SIGNATURES.columns_of_rows(rows)


def parameters_of(fit: Fit) -> dict[str, dict[str, float]]:
    """Fitted parameters by effect and name, six digits."""
    return {
        effect.name: {p.name: float(f"{v:.6g}") for p, v in zip(effect.parameters, values, strict=True)}
        for effect, values in fit.model.split(fit.values.tolist())
    }


def candidate_rows(identification: Identification) -> Columns:
    """Columns of `CANDIDATES`: fitted ones, the most probable first, then the untestable."""
    selection = identification.selection
    fitted_names = sorted(selection.trials, key=lambda name: -selection.trials[name].evidence.value)
    unsolved_names = sorted(
        set(selection.promised_misfits) - set(fitted_names), key=lambda name: selection.promised_misfits[name]
    )
    names = (*fitted_names, *unsolved_names, *identification.why_not)
    return CANDIDATES.columns_of_rows([_candidate(identification, name) for name in names])


def _candidate(identification: Identification, name: str) -> dict[str, Any]:
    selection, why_not = identification.selection, identification.why_not
    trial = selection.trials.get(name)
    reason = why_not.get(name, selection.reasons.get(name, "") if trial else NOT_SOLVED)
    odds = selection.odds.get(name, np.nan)
    gain = trial.evidence.predictive - selection.base.evidence.predictive if trial else np.array([np.nan])
    return {
        "effect": name,
        "title": title_of(name),
        "parameters": json.dumps(parameters_of(trial.fit)) if trial else "",
        "misfit_before": selection.base.rms if trial else np.nan,
        "misfit_after": trial.rms if trial else np.nan,
        "log_odds": odds,
        "log_score_gain": float(np.sum(gain)),
        "significant": bool(odds >= NAMED_ODDS),
        "member_of_class": name in identification.verdict.named_effects,
        "screened_share": selection.promised_misfits.get(name, np.nan),
        "why_not": reason,
    }
