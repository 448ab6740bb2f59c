"""Pages on a population of units, and on a drive of which no design is known."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.config.studies.study import Study
from pipeline.engine.store import write_atomic
from pipeline.figures.labels import METRICS, PARAMETERS
from pipeline.figures.measured_unit import (
    DESCRIPTION_STYLES,
    REMAINDER_TITLES,
    loops_figure,
    quantiles_figure,
    torque_figure,
)
from pipeline.identification.described.description import Description, Number
from pipeline.identification.described.results import TITLES, content
from pipeline.identification.results.residual_signatures import Signature
from pipeline.populations.comparison import MetricComparison
from pipeline.populations.results import comparison_frame, quantile_frame, sentence
from pipeline.populations.single_units import SingleUnits
from pipeline.populations.tolerance_shift import Candidate, Closing
from pipeline.report.layout import DASH, drawn_picture, drawn_pictures, listed_text, render
from pipeline.report.unit.facts import discrepancy_facts
from pipeline.report.unit.rows import digits, interval, p_value


def write_population_page(
    study: Study,
    units: str,
    turn_statistic: str,
    comparisons: Sequence[MetricComparison],
    closings: Mapping[float | None, Closing],
    single: Sequence[SingleUnits],
    noise_percent: float | None,
    folder: Path,
) -> None:
    """Write population.html and its figure into ``folder``.

    Parameters
    ----------
    units : name of the file of the units.
    turn_statistic : "mean" or "worst" over the crank angles, of the samples that units without a crank angle are
        compared with.
    noise_percent : repeatability of the bench, if it was stated.
    """
    quantiles = quantile_frame(comparisons)
    quantiles["label"] = [
        _at_crank(METRICS[metric].title, crank, separator="\n")
        for metric, crank in zip(quantiles["metric"], quantiles["crank_deg"], strict=True)
    ]
    quantiles["unit"] = [METRICS[metric].unit for metric in quantiles["metric"]]
    caption = (
        "Each dot is one probability, 5 % to 95 %. On the dashed line units and study are alike. Dots above it mean "
        "larger values of the units; a steeper line of dots means more spread."
    )
    picture = drawn_picture(
        quantiles_figure(quantiles),
        "Quantiles of the units against the study",
        caption,
        folder / "figures" / "quantiles",
    )
    page = render(
        "unit/population.html",
        study=study,
        units=units,
        biases=_biases(comparisons),
        angles=_angles(study, turn_statistic, closings),
        repeatability="" if noise_percent is None else f"Repeatability of the bench: {noise_percent:g} % of a value.",
        sentences=[
            (_where(crank, turn_statistic), sentence(closing, [one for one in comparisons if one.crank_deg == crank]))
            for crank, closing in closings.items()
        ],
        comparisons=[_comparison(row) for row in comparison_frame(comparisons).to_dict("records")],
        single=[(_where(group.crank_deg, turn_statistic), group.sentence) for group in single],
        candidates=[
            _candidate(candidate, crank)
            for crank, found in closings.items()
            if found.has_bias
            for candidate in found.candidates
        ],
        pictures={"quantiles": picture},
    )
    write_atomic(folder / "population.html", page.encode())


def _angles(study: Study, turn_statistic: str, cranks: Iterable[float | None]) -> str:
    """One sentence on the crank angles that the samples are taken at."""
    if None not in cranks:
        return "Each sample is taken at the crank angle that the unit was measured at (column crank_deg)."
    other_statistic = "worst" if turn_statistic == "mean" else "mean"
    return (
        f"The units name no crank angle, so each sample is taken as its {turn_statistic} over the "
        f"{len(study.cycle.crank_deg)} crank angles of the study. A bench that measures at known angles gives them in "
        f"a column crank_deg; --over {other_statistic} takes the {other_statistic} value instead."
    )


def _where(crank: float | None, turn_statistic: str) -> str:
    return f"{turn_statistic} over the crank angles" if crank is None or np.isnan(crank) else f"crank at {crank:g}°"


def _range(low: float, high: float) -> str:
    ends = digits(low), digits(high)
    return "" if ends == (DASH, DASH) else f"{ends[0]} to {ends[1]}"


def _at_crank(title: str, crank: float | None, separator: str = ", ") -> str:
    """A title with the crank angle; without one it is that of the note on the angles."""
    return title if crank is None or np.isnan(crank) else f"{title}{separator}crank at {crank:g}°"


def _comparison(row: Mapping[str, object]) -> dict[str, object]:
    numbers = pd.Series(row)
    return {
        "title": _at_crank(METRICS[str(row["metric"])].title, numbers["crank_deg"]),
        "unit": METRICS[str(row["metric"])].unit,
        "units": numbers["units"],
        "means": (digits(numbers["units_mean"]), digits(numbers["samples_mean"])),
        "bias": digits(numbers["bias"]),
        "bias_range": _range(numbers["bias_ci_low"], numbers["bias_ci_high"]),
        "spread": digits(numbers["spread_ratio"]),
        "spread_range": _range(numbers["spread_ratio_ci_low"], numbers["spread_ratio_ci_high"]),
        "p": p_value(numbers["anderson_darling_p"]),
    }


def _biases(comparisons: Sequence[MetricComparison]) -> str:
    """Differences of the means with their intervals, in a sentence; empty where there are too many for one."""
    if len({comparison.metric for comparison in comparisons}) < len(comparisons):
        return ""
    texts = [
        f"{METRICS[one.metric].inline} {'+' * (one.bias.value > 0)}{digits(one.bias.value)} {METRICS[one.metric].unit} "
        f"(95 % interval {_range(one.bias.ci_low, one.bias.ci_high)})"
        for one in comparisons
    ]
    return f"Mean of the units less mean of the study: {listed_text(texts)}."


def _candidate(candidate: Candidate, crank: float | None) -> dict[str, object]:
    allowed = f", up to the limit of {digits(candidate.room_um)} µm" if candidate.is_beyond_room else ""
    return {
        "title": _at_crank(PARAMETERS[candidate.tolerance], crank),
        "shift": digits(candidate.shift_um),
        "shift_range": _range(candidate.shift_low_um, candidate.shift_high_um),
        "room": digits(candidate.room_um),
        "explained": f"{100 * candidate.explained:.0f} %",
        "p": p_value(candidate.p_value),
        "closes": f"yes{allowed}" if candidate.closes else "no",
    }


CAPTIONS = {
    "loops": (
        "Loops",
        "Dots: cells, averages of neighbouring rows of a branch. Lines: predictions of fits that have not seen the "
        "held-out cells. The offset of the angle is removed.",
    ),
    "torque": ("Residual over torque", "Branches that part show friction, a step at zero torque play."),
}


def write_description_page(
    description: Description,
    signatures_left: Sequence[Signature],
    frames: dict[str, pd.DataFrame],
    folder: Path,
    shown_folder: Path,
) -> None:
    """Write report.html and its figures into ``folder``.

    Parameters
    ----------
    signatures_left : signatures of what the description leaves.
    frames : tables that were written there.
    shown_folder : the folder as a user would type it.
    """
    cells = frames["description"]
    figures = {"loops": loops_figure(cells, DESCRIPTION_STYLES), "torque": torque_figure(cells, REMAINDER_TITLES)}
    pictures = drawn_pictures(figures, CAPTIONS, folder)
    errors = {TITLES[name].capitalize(): error for name, error in description.errors.items()} | dict(
        description.baselines
    )
    page = render(
        "unit/description.html",
        verdict=content(description),
        numbers=[_number(number) for number in description.numbers],
        errors=[
            (title[:1].upper() + title[1:], digits(e.rms_arcmin), digits(e.to_noise)) for title, e in errors.items()
        ],
        signatures=[_signature(signature) for signature in signatures_left if not signature.why_not],
        left=_remaining_facts(description),
        folder=shown_folder,
        tables=list(frames),
        faults=[(description.measurement.unit.name, fault) for fault in description.measurement.faults],
        pictures=pictures,
    )
    write_atomic(folder / "report.html", page.encode())


def _number(number: Number) -> dict[str, str | bool]:
    return {
        "meaning": number.meaning[:1].upper() + number.meaning[1:],
        "value": digits(number.value),
        "unit": "" if number.unit == "1" else number.unit,
        "interval": interval(number.ci_low, number.ci_high) or "none",
        "p": digits(number.p, 2),
        "named": number.named,
    }


def _remaining_facts(description: Description) -> list[tuple[str, str]]:
    """What the description leaves, in words; nothing where nothing is left."""
    structure = description.structure
    if structure is None:
        return []
    rows = zip(description.numbers, structure.moved.tolist(), structure.error.tolist(), strict=True)
    moved_facts = [(n.meaning.split(":")[0], step, error, "" if n.unit == "1" else n.unit) for n, step, error in rows]
    return discrepancy_facts(structure, moved_facts)


def _signature(signature: Signature) -> tuple[str, str, str, str, bool]:
    title = signature.title[:1].upper() + signature.title[1:]
    value, ends = digits(signature.value), interval(signature.ci_low, signature.ci_high)
    return title, signature.unit, value, ends, signature.significant
