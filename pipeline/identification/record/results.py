"""What the answer on a record leaves behind: its sentences, verdict.json and tables."""

from dataclasses import asdict, astuple
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.engine.store import write_json, write_tables
from pipeline.engine.table import Column, Columns, Table
from pipeline.identification.measurement.faults.branch_faults import FEWEST_BLOCKS
from pipeline.identification.record.answer import RecordAnswer, Value, effect_values
from pipeline.identification.results.write import finite
from pipeline.identification.selection.statements.verdict import NOT_TESTABLE, UNEXPLAINED, VERDICT_FILE

POINTS = Table(
    "points",
    "held torque, sense, temperature, interval of the output angle",
    (
        Column("kind", "int32", "1", "number of the held torque, sense and temperature"),
        Column("torque_Nm", "float64", "N m", "torque held on the output"),
        Column("sense", "int32", "1", "1 where the output turns forward, -1 backward"),
        Column("temperature_C", "float64", "deg C", "mean temperature of the passes; null where not measured"),
        Column("output_deg", "float64", "deg", "middle of the interval, from the first angle of the record"),
        Column("error_arcmin", "float64", "arcmin", "mean error of the output against the ideal ratio"),
        Column("predicted_arcmin", "float64", "arcmin", "by the named effects, the terms of every drive and the zeros"),
        Column("noise_arcmin", "float64", "arcmin", "standard deviation of the mean, by what repeats scatter"),
    ),
)
ORDERS = Table(
    "orders",
    "order",
    (
        Column("order", "float64", "1", "waves per turn of the output"),
        Column("of", "label", "", "what turns so often; empty of no shaft"),
        Column("amplitude_arcsec", "float64", "arcsec", "amplitude of what all passes share"),
        Column("ci_low_arcsec", "float64", "arcsec", "lower end of its 95 % interval"),
        Column("ci_high_arcsec", "float64", "arcsec", "upper end"),
        Column("per_torque_arcsec", "float64", "arcsec", "amplitude of what is in proportion, at the largest torque"),
        Column("senses_arcsec", "float64", "arcsec", "amplitude of half the difference of the senses"),
        Column("significant", "bool", "", "whether noise alone gives one so large with at most 5 % over all orders"),
    ),
)
LEVELS = Table(
    "levels",
    "held torque",
    (
        Column("torque_Nm", "float64", "N m", "torque held on the output"),
        Column("mean_arcmin", "float64", "arcmin", "mean of the senses, about the middle of all torques"),
        Column("mean_error_arcmin", "float64", "arcmin", "its standard error"),
        Column("difference_arcmin", "float64", "arcmin", "forward less backward; null where one is missing"),
        Column("difference_error_arcmin", "float64", "arcmin", "its standard error"),
    ),
)


def write(answer: RecordAnswer, folder: Path) -> dict[str, pd.DataFrame]:
    """Write tables and, last, the verdict into ``folder``; the frames by name."""
    tables = {
        POINTS: _points(answer),
        ORDERS: ORDERS.columns_of_rows([astuple(row) for row in answer.orders]),
        LEVELS: LEVELS.columns_of_rows([astuple(row) for row in answer.levels]),
    }
    frames = write_tables(tables, folder)
    write_json(folder / VERDICT_FILE, finite(content(answer)))
    return frames


def sentences(answer: RecordAnswer) -> tuple[str, ...]:
    """The verdict in words, the numbers of the drive, and what to measure next."""
    judgement = answer.judgement
    named_models = " or ".join(_model_title(answer, names) for names in judgement.named_effects)
    values = effect_values(answer) if judgement.members else []
    sizes = "; ".join(words(value) for value in values if value.name not in judgement.tolerated_waves)
    small = "; ".join(words(value) for value in values if value.name in judgement.tolerated_waves)
    sizes += f"; beside it, no more than errors of parts within their tolerances cause: {small}" if small else ""
    if judgement.members:
        first_sentence = f"{judgement.verdict}: {sizes if len(judgement.named_effects) == 1 else named_models}."
    else:
        reason = f" {judgement.finding[:1].upper()}{judgement.finding[1:]}." if judgement.finding else ""
        first_sentence = f"{judgement.verdict}: no effect is named.{reason}"
    numbers = "; ".join(words(value) for value in answer.values)
    held_out = ""
    if answer.held_out:
        rms = float(np.sqrt(np.mean([row.rms**2 for row in answer.held_out])))
        base = float(np.sqrt(np.mean([row.base_rms**2 for row in answer.held_out])))
        about = ", about the mean of each pass" if answer.evidence.are_waves(answer.judgement.answer.effects) else ""
        held_out = (
            f"Each {answer.held_out_by} predicted from the others{about}: {60 * rms:.3g} arcsec root mean square, "
            f"{60 * base:.3g} without effects (noise {60 * answer.noise:.2g})."
        )
    return tuple(
        filter(
            None, (first_sentence, f"{numbers[:1].upper()}{numbers[1:]}." if numbers else "", held_out, advice(answer))
        )
    )


def _model_title(answer: RecordAnswer, model: str) -> str:
    return " and ".join(answer.titles[name] for name in model.split("+"))


def words(value: Value) -> str:
    """A number with its interval."""
    scale, unit = (60.0, "arcsec") if value.unit == "arcmin" else (1.0, value.unit)
    low, high = scale * value.ci_low, scale * value.ci_high
    return f"{value.title} {scale * value.value:.3g} {unit} (95 % interval {low:.3g} to {high:.3g})"


def advice(answer: RecordAnswer) -> str:
    """What to measure next."""
    record = answer.record
    if len(record.passes) < FEWEST_BLOCKS:
        return f"Make at least {FEWEST_BLOCKS} passes: several held torques, both senses, each twice."
    if answer.judgement.verdict == NOT_TESTABLE:
        return "Hold three torques or more: each is then predicted from the others."
    if answer.judgement.verdict == UNEXPLAINED and np.isinf(answer.points.drift):
        return "Make each pass twice: without repeats the bench's drift cannot be told from what no effect explains."
    if answer.judgement.verdict == UNEXPLAINED:
        return "Compare the orders that grow with the torque with the speeds of all shafts and teeth."
    missing = sorted(
        {reason for reason in answer.why_not.values() if reason.startswith(("a single", "the drive", "no"))}
    )
    return f"Not tested: {'; '.join(missing)}." if missing else ""


def content(answer: RecordAnswer) -> dict[str, Any]:
    """Content of verdict.json."""
    judgement, unit = answer.judgement, answer.record.unit
    return {
        "unit": unit.name,
        "title": unit.settings.title,
        "verdict": judgement.verdict,
        "named": list(judgement.named_effects),
        "within_tolerance": list(judgement.tolerated_waves),
        "sentences": list(sentences(answer)),
        "numbers": [asdict(value) for value in answer.values],
        "conditions": [asdict(row) for row in answer.conditions],
        "effects": [asdict(value) for value in effect_values(answer)],
        "odds": dict(judgement.odds),
        "reasons": dict(judgement.reasons),
        "finding": judgement.finding,
        "not_tested": answer.why_not,
        "held_out_by": answer.held_out_by,
        "held_out_errors": [asdict(row) for row in answer.held_out],
        "period_output_turns": answer.record.orders.period,
        "noise_arcmin": answer.noise,
        "data_faults": [asdict(fault) for fault in answer.record.faults],
    }


def _points(answer: RecordAnswer) -> Columns:
    points, record = answer.points, answer.record
    passes = record.passes
    warm = np.array([passes.temperature[passes.kind == kind].mean() for kind in range(int(passes.kind.max()) + 1)])
    return {
        "kind": points.kind,
        "torque_Nm": record.levels[points.level],
        "sense": points.sense,
        "temperature_C": warm[points.kind],
        "output_deg": (points.interval + 0.5) * record.span_deg / record.n_intervals,
        "error_arcmin": points.error,
        "predicted_arcmin": answer.predicted_error,
        "noise_arcmin": points.noise,
    }
