"""Rows of the tables on the page on a measured unit."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from pipeline.config.files.section import number_at
from pipeline.figures.labels import METRICS
from pipeline.identification.fitting.problem import candidates
from pipeline.identification.identify import Identification
from pipeline.identification.results.prediction_errors import SEPARATION, LoopError
from pipeline.identification.results.residual_signatures import Signature
from pipeline.identification.results.turn_signatures import ORDER, ORDERS, SPAN
from pipeline.identification.selection.held_out import STAGES, AngleError
from pipeline.identification.selection.statements.detection import DetectionLimit
from pipeline.identification.selection.statements.remainder import Remainder
from pipeline.identification.selection.statements.verdict import UNEXPLAINED
from pipeline.report.layout import DASH, plain_number

SMALLEST_P = 1e-3
"""Below it the page says so: the resamples tell no smaller one."""


def digits(value: float | None, figures: int = 3) -> str:
    """A number with three significant digits; an en dash for none."""
    if value is None or not math.isfinite(value):
        return DASH
    if value == 0:
        return "0"
    places = max(figures - 1 - math.floor(math.log10(abs(value))), 0)
    text = f"{value:,.{places}f}" if places <= 6 else f"{value:.{figures - 1}e}"
    return text.replace("-", "\u2212")


def interval(low: float | None, high: float | None) -> str:
    """Two ends; empty without one of them."""
    ends = digits(low), digits(high)
    return "" if DASH in ends else f"{ends[0]} to {ends[1]}"


def p_value(value: float) -> str:
    """A p-value, or that it is less than any that is told apart."""
    return DASH if not math.isfinite(value) else f"< {SMALLEST_P:g}" if value < SMALLEST_P else f"{value:.3f}"


def with_capital(text: str) -> str:
    """The text with a capital first letter."""
    return text[:1].upper() + text[1:]


def shown_unit(text: str) -> str:
    """A unit as it is printed; nothing for a pure number."""
    return "" if text == "1" else text.replace("um", "µm")


def remainder_cards(identification: Identification) -> list[tuple[str, str, str, str]]:
    """Cards of what the nearest effects leave that are not named: the share removed, and the rest beside noise."""
    if identification.verdict.verdict != UNEXPLAINED or not identification.selection.best_model:
        return []
    remainder, floor = identification.remainder, identification.remainder.noise_arcmin
    title, best_error = min(identification.baselines.items(), key=lambda item: item[1].to_noise)
    size = remainder.scatter.size if remainder.scatter else math.nan
    return [
        ("By the nearest", f"{remainder.removed:.0%}", "", "of the refitted model's held-out error is removed"),
        ("Not traced", digits(remainder.rms_arcmin), "arcmin", f"beside a noise floor of {digits(floor)} arcmin"),
        ("Of it alike everywhere", digits(remainder.common_arcmin), "arcmin", "common to all positions"),
        ("Of it by position", digits(size), "arcmin", scatter_words(remainder)),
        ("Best without a reducer", digits(best_error.rms_arcmin), "arcmin", title),
    ]


def scatter_words(remainder: Remainder) -> str:
    """How sure the scatter between positions is."""
    scatter = remainder.scatter
    if scatter is None:
        return "one position: not known apart"
    limits = interval(scatter.ci_low, scatter.ci_high)
    return f"scatter between {scatter.groups} positions, 95 % interval {limits}"


def written_facts(verdict: Mapping[str, Any]) -> tuple[str, str, str] | None:
    """Name of the written study, what it leaves of the measured angles [arcmin], and what its fit does."""
    written_study = verdict["written"]
    if written_study is None:
        return None
    return written_study["study"], digits(written_study["rms_arcmin"]), digits(written_study["fit_rms_arcmin"])


OTHER_TITLES = {
    SEPARATION: "Separation of the branches under load",
    SPAN: "Transmission error, least to largest over a turn",
    **{ORDER.format(order): f"Order {order} of the crank" for order in ORDERS},
}
"""Of what is read off a measured loop or turn in arcmin and is no metric of a study's loop."""


def headline(title: str, error: AngleError) -> tuple[str, str, str, str]:
    """The error of one of the models as the page shows it first: title, value, unit and a note."""
    return title, digits(error.rms_arcmin), "arcmin", f"{digits(error.to_noise)} × measurement noise"


def error_row(title: str, error: AngleError, by_crank: bool = True) -> dict[str, Any]:
    """The error of the angle of one of the models, by crank angle too where that is wanted."""
    return {
        "title": title,
        "rms": digits(error.rms_arcmin),
        "by_crank": [digits(rms) for rms in error.by_crank_deg.values()] if by_crank else [],
        "largest": digits(error.max_arcmin),
        "to_noise": digits(error.to_noise),
        "expected": digits(error.expected_to_noise),
    }


def signature_row(pair: Sequence[Signature]) -> dict[str, Any]:
    """A signature before and after the model."""
    cells = [_signature(estimate) for estimate in pair]
    return {"title": with_capital(pair[0].title), "unit": pair[0].unit, "cells": cells}


def baseline_row(title: str, error: AngleError) -> dict[str, str]:
    """The error of a model without mechanics."""
    return {"title": with_capital(title), "rms": digits(error.rms_arcmin), "to_noise": digits(error.to_noise)}


def limit_row(limit: DetectionLimit) -> tuple[str, str, str, str]:
    """The sizes at which an effect would be noticed and named: its title, its parameter, both sizes."""
    effect = candidates()[limit.effect]
    (parameter,) = (p for p in effect.parameters if p.name == limit.parameter)
    noticed_text, named_text = (
        f"{digits(size)} {shown_unit(limit.unit)}".rstrip() if math.isfinite(size) else "at no size"
        for size in (limit.noticed, limit.named)
    )
    return with_capital(effect.title), parameter.meaning, noticed_text, named_text


def parameter_row(record: Mapping[str, Any]) -> dict[str, str]:
    """A fitted parameter with its interval."""
    effect = candidates()[record["effect"]]
    (parameter,) = [p for p in effect.parameters if p.name == record["name"]]
    return {
        "effect": with_capital(effect.title),
        "meaning": parameter.meaning,
        "value": digits(record["value"]),
        "interval": interval(record["ci_low"], record["ci_high"]) or "none",
        "unit": shown_unit(record["unit"]),
        "note": record["note"],
    }


def candidate_row(row: Mapping[str, Any], parameters: Mapping[str, Mapping[str, float]]) -> dict[str, str]:
    """A fitted candidate with its ``parameters`` by effect, its gain and what became of it."""
    if row["member_of_class"]:
        judgement = "named"
    elif row["significant"]:
        clearly = "not clearly more" if "+" in row["effect"] else "less"  # a second effect needs the odds, not a gain
        judgement = row["why_not"] or f"{clearly} probable than what is named"
    else:
        judgement = row["why_not"] or "no effect is not rejected"
    return {
        "title": with_capital(row["title"]),
        "parameters": _numbers(parameters),
        "before": digits(row["misfit_before"]),
        "after": digits(row["misfit_after"]),
        "odds": _signed_text(row["log_odds"]),
        "gain": _signed_text(row["log_score_gain"]),
        "judgement": judgement,
    }


def _signed_text(value: float) -> str:
    return f"{value:.1f}".replace("-", "\u2212") if math.isfinite(value) else DASH


def _numbers(parameters: Mapping[str, Mapping[str, float]]) -> str:
    texts = []
    for effect, values in parameters.items():
        for parameter in candidates()[effect].parameters:
            number = digits(values[parameter.name])
            texts.append(f"{parameter.meaning}: {number} {shown_unit(parameter.unit)}".rstrip())
    return "; ".join(texts)


def _signature(signature: Signature) -> dict[str, Any]:
    return {
        "value": digits(signature.value),
        "interval": signature.why_not or interval(signature.ci_low, signature.ci_high),
        "strong": signature.significant,
    }


def loop_row(name: str, error: LoopError) -> dict[str, Any]:
    """A metric of the loop as it was measured and as each of the models predicts it."""
    title, unit = (OTHER_TITLES[name], "arcmin") if name in OTHER_TITLES else (METRICS[name].title, METRICS[name].unit)
    if error.measured_value is None:
        return {"title": title, "unit": unit, "why_not": error.why_not}
    return {
        "title": title,
        "unit": unit,
        "why_not": "",
        "measured": digits(error.measured_value),
        "cells": [
            (
                digits(error.predicted_values[stage]),
                f"error {digits(error.predicted_values[stage] - error.measured_value)}",
            )
            for stage in STAGES
        ],
    }


def calibrated_rows(identification: Identification) -> list[tuple[str, ...]]:
    """Refitted numbers: key or title, value as declared and as fitted, factor, its intervals, what is open of it."""
    design, keys = identification.measurement.unit.study.design, identification.problem.calibrated_keys
    rows: list[tuple[str, ...]] = []
    for number in identification.verdict.calibrated_numbers:
        value = float(number_at(design, number.key)) if number.key in keys else math.nan
        values = (plain_number(value), digits(value * number.factor)) if number.key in keys else (DASH, DASH)
        intervals = interval(number.ci_low, number.ci_high), interval(number.plausible_low, number.plausible_high)
        rows.append((number.key, *values, digits(number.factor), *intervals, number.note))
    return rows
