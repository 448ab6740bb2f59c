"""Pages on worst cases over a tolerance box and on the cheapest tolerances."""

from pathlib import Path
from typing import Any

import pandas as pd

from pipeline import assembly
from pipeline.config.studies.study import ALL_LIMITS, Study
from pipeline.config.tolerance_notation import PIN_COORDINATES
from pipeline.decisions.allocation import Allocation, Choice, allocation_rows, check_rows
from pipeline.decisions.bounds import (
    BOUNDS,
    CAPABILITY,
    CONTRIBUTIONS,
    STACKS,
    WORST_FOUND,
    WORST_OF_VALID,
    BoundFindings,
    table_rows,
)
from pipeline.decisions.fresh_units import PRELOADED, WITHOUT_RESULT
from pipeline.engine.store import write_atomic
from pipeline.figures.decisions import bounds_figure, tradeoff_figure
from pipeline.figures.labels import METRICS, PARAMETERS
from pipeline.model.metrics import library
from pipeline.report.layout import (
    Picture,
    drawn_picture,
    drawn_pictures,
    number,
    percent,
    percent_interval,
    render,
    rounded_number,
)
from pipeline.report.results import preload_sentence
from pipeline.sampling.errors import varies

LARGEST_GAP = 0.1
"""Relative error of the linear stack's standard deviation beyond which its contributions are marked."""
STATISTICS = {"mean": "mean", "std": "standard deviation", "far": "99.73 % quantile (unfavourable side)"}


def write_bounds_page(bound_findings: BoundFindings, folder: Path) -> None:
    """Write report.html into ``folder``."""
    tables = {table: pd.DataFrame(rows) for table, rows in table_rows(bound_findings).items()}
    invalid = invalid_stacks(tables[STACKS])
    page = render(
        "decisions/bounds.html",
        study=bound_findings.study,
        sentence=bounds_sentence(tables[BOUNDS], tables[STACKS]) + square_sentence(bound_findings.study),
        definitions=_definitions(bound_findings.study, list(dict.fromkeys(tables[BOUNDS]["metric"]))),
        bounds=[_bound(row) for row in tables[BOUNDS].to_dict("records")],
        stacks=[_stack(row) for row in tables[STACKS].to_dict("records")],
        cranks=sorted(set(tables[CONTRIBUTIONS]["crank_deg"])),
        contributions=_contributions(tables[CONTRIBUTIONS], invalid),
        invalid=[METRICS[name].inline for name in invalid],
        largest_gap=percent(LARGEST_GAP),
        capabilities=[_capability(row) for row in tables[CAPABILITY].to_dict("records")],
        pictures={"bounds": _picture(tables[BOUNDS], tables[STACKS], folder)},
    )
    write_atomic(folder / "report.html", page.encode())


def bounds_sentence(bounds: pd.DataFrame, stacks: pd.DataFrame) -> str:
    """The worst case of every metric at any crank angle, and how far single drawn units come.

    Parameters
    ----------
    bounds, stacks : rows of `BOUNDS` and `STACKS`.
    """
    parts: dict[bool, list[str]] = {True: [], False: []}
    for name, rows in bounds.groupby("metric", sort=False):
        metric = METRICS[str(name)]
        extreme, side = (pd.Series.min, "at least") if metric.smaller_is_worse else (pd.Series.max, "at most")
        far_stacks = stacks[(stacks["metric"] == name) & (stacks["statistic"] == "far")]["full"]
        unit = "" if metric.unit == "1" else f" {metric.unit}"
        drawn_text = (
            f" (99.73 % of drawn units at any one of these angles: {side} {number(extreme(far_stacks), metric)}{unit})"
            if len(far_stacks)
            else ""
        )
        is_exact = not set(rows["what"]) & {WORST_FOUND, WORST_OF_VALID}
        parts[is_exact].append(f"{metric.inline} {number(extreme(rows['value']), metric)}{unit}{drawn_text}")
    angles = ", ".join(f"{crank:.4g}°" for crank in sorted(set(bounds["crank_deg"])))
    invalid = (
        " Some errors within the limits lead beyond where the model is valid; such units are in none of these values."
        if (bounds["what"] == WORST_OF_VALID).any()
        else ""
    )
    return (
        f"With every error anywhere within its limits, at the crank angles looked at ({angles}), the worst is "
        f"{', '.join(parts[True])}. The worst found under load, where a search may miss worse cases, is "
        f"{', '.join(parts[False])}.{invalid} Over a whole turn more units exceed a value than at one angle, and units "
        "may be worse at other angles."
    )


def square_sentence(study: Study) -> str:
    """That the places of the housing's pins fill squares, where both directions vary; empty where they do not."""
    if not all(varies(study, name) for name in PIN_COORDINATES):
        return ""
    return (
        " The radial and the tangential limits of a housing pin make a rectangle, whose corners count too. For a "
        "circular zone (pin_position) it is a square: with a normal distribution one about the circle, whose largest "
        "play is at most that of the square; with a uniform one its corners lie at 1.22 times the circle's radius and "
        "its sides at 0.87 times, so that the worst over the circle may lie on either side."
    )


def _definitions(study: Study, names: list[str]) -> list[tuple[str, str]]:
    """Title and definition of metrics, with the torques at which they are read."""
    torques = vars(assembly.definitions(study))
    return [(library()[name].title, library()[name].definition.format(**torques)) for name in names]


def _picture(bounds: pd.DataFrame, stacks: pd.DataFrame, folder: Path) -> Picture:
    """The figure, written into ``folder`` too."""
    caption = (
        "Of single units at each crank angle. Diamonds: worst cases over the tolerance box, of the play its largest "
        "and least from both sides. Bars: three standard deviations about the mean, of the full model and of the "
        "linear stack; where they differ, a linear stack-up is not valid."
    )
    title, figure = "Worst case, linear stack and Monte Carlo", bounds_figure(bounds, stacks)
    return drawn_picture(figure, title, caption, folder / "figures" / "bounds")


def _bound(row: dict[str, Any]) -> tuple[str, str, str, str]:
    quantity = METRICS[row["metric"]]
    return quantity.axis, f"{row['crank_deg']:.4g}", row["what"], number(row["value"], quantity)


def _stack(row: dict[str, Any]) -> dict[str, str]:
    quantity = METRICS[row["metric"]]
    gap = row["linear"] / row["full"] - 1 if row["full"] else float("nan")
    return {
        "title": quantity.axis,
        "crank": f"{row['crank_deg']:.4g}",
        "statistic": STATISTICS[row["statistic"]],
        "linear": number(row["linear"], quantity),
        "full": number(row["full"], quantity),
        "gap": percent(gap),
    }


def invalid_stacks(stacks: pd.DataFrame) -> list[str]:
    """Metrics whose linear stack misses the standard deviation of the full model at some crank angle."""
    spread = stacks[stacks["statistic"] == "std"]
    is_off = (spread["linear"] - spread["full"]).abs() > LARGEST_GAP * spread["full"]
    return list(dict.fromkeys(spread.loc[is_off, "metric"].astype(str)))


def _contributions(table: pd.DataFrame, invalid: list[str]) -> list[tuple[str, str, list[str]]]:
    rows = []
    for (metric, parameter), part in table.groupby(["metric", "parameter"], sort=False):
        by_crank = part.set_index("crank_deg")["percent"].sort_index()
        mark = " (not valid)" if metric in invalid else ""
        shares = [percent(value / 100) for value in by_crank]
        rows.append((f"{METRICS[metric].title}{mark}", PARAMETERS[parameter], shares))
    return rows


def _capability(row: dict[str, Any]) -> dict[str, object]:
    quantity = METRICS[row["metric"]]
    return {
        "title": quantity.axis,
        "mean": number(row["mean"], quantity),
        "std": number(row["std"], quantity),
        "cpk": f"{row['cpk']:.2f}",
        "normal": percent(row["yield_if_normal"]),
        "yield": percent(row["yield"]),
        "ends": percent_interval(row["ci_low"], row["ci_high"]),
        "normality": f"{'not rejected' if row['is_normal_plausible'] else 'rejected'} (n = {row['n']:,})",
    }


CHOICES = {
    "before": "tolerances of the study",
    "equal": "all priced tolerances scaled alike",
    "found": "cheapest found",
}


def sentence(allocation: Allocation) -> str:
    """What was found, in a few sentences."""
    cheapest, stated_choice = allocation.cheapest, allocation.stated_choice
    if not allocation.reaches_target:
        return (
            f"The target of {_share(allocation.target)} is not reached. The best tolerances found give "
            f"{_yield(cheapest)} and cost {cheapest.cost:.3g}; those of the study give {_yield(stated_choice)} and "
            f"cost {stated_choice.cost:.3g}. Most failing units break {allocation.hardest_limit}: loosen this limit, "
            f"change an allowance, or state the cost of further tolerances. {more_preload_sentence(allocation)}"
        ).rstrip()
    text = (
        f"The cheapest tolerances found for a yield of {_share(allocation.target)} cost {cheapest.cost:.3g} and give "
        f"{_yield(cheapest)}; those of the study cost {stated_choice.cost:.3g} and give {_yield(stated_choice)}."
    )
    if cheapest.yield_estimate.ci_low < allocation.target:
        text += " The check on fresh units does not exclude a yield below the target; more units narrow its interval."
    text = f"{text} {more_preload_sentence(allocation)}".rstrip()
    if allocation.equal is None:
        return f"{text} Scaling all priced tolerances alike does not reach the target."
    alike = f"Scaling all of them alike costs {allocation.equal.cost:.3g} and gives {_yield(allocation.equal)}"
    reached = [choice.yield_estimate.value >= allocation.target for choice in (cheapest, allocation.equal)]
    if reached[0] != reached[1]:  # what costs less gives less
        missing = "the tolerances found" if reached[1] else "scaling alike"
        return f"{text} {alike}: by these checks {missing} miss{'' if reached[1] else 'es'} the target."
    saving = 1 - cheapest.cost / allocation.equal.cost
    return f"{text} {alike}: the allocation is {100 * abs(saving):.1f} % {'cheaper' if saving >= 0 else 'dearer'}."


def more_preload_sentence(allocation: Allocation) -> str:
    """That more units are preloaded than with the tolerances of the study; empty where they are not."""
    cheapest, stated_choice = allocation.cheapest, allocation.stated_choice
    if not cheapest.has_more_preload(stated_choice, allocation.study.metrics.confidence):
        return ""
    shares = {
        "the units with the cheapest tolerances found": cheapest.check[PRELOADED].value,
        "those with the tolerances of the study": stated_choice.check[PRELOADED].value,
    }
    advice = "Before these tolerances are used, narrow those that were loosened most, or enlarge an allowance."
    return preload_sentence(shares, advice)


def _yield(choice: Choice) -> str:
    estimate = choice.yield_estimate
    interval = f"{100 * estimate.ci_low:.1f} to {_share(estimate.ci_high)}"
    missing = choice.check[WITHOUT_RESULT].value
    failed = f", {_share(missing)} of them without a result, which count as failed" if missing else ""
    return f"{_share(estimate.value)} ({interval}, {estimate.n:,} new units{failed})"


def _share(value: float) -> str:
    return f"{100 * value:.1f} %"


def write_allocation_page(allocation: Allocation, file: str, folder: Path) -> None:
    """Write report.html and its figure into ``folder``; ``file`` names the study file beside it."""
    rows = pd.DataFrame(allocation_rows(allocation)).to_dict("records")
    checks = pd.DataFrame(check_rows(allocation)).to_dict("records")
    page = render(
        "decisions/allocation.html",
        study=allocation.study,
        sentence=sentence(allocation),
        file=file,
        rows=[
            {
                "title": PARAMETERS[row["dimension"]],
                "limits": f"{rounded_number(row['lower_um'])} to {rounded_number(row['upper_um'])}",
                **{key: rounded_number(row[key]) for key in ("was", "width_um", "was_cost", "cost", "price_per_um")},
            }
            for row in rows
        ],
        checks=[
            {
                "choice": CHOICES[row["tolerances"]],
                "title": "All limits" if row["metric"] == ALL_LIMITS else METRICS[row["metric"]].title,
                "yield": _share(row["yield"]),
                "ends": f"{_share(row['ci_low'])} to {_share(row['ci_high'])}",
                "preloaded": _share(row["preloaded"]),
                "n": f"{row['n']:,}",
                "cost": rounded_number(row["cost"]),
            }
            for row in checks
        ],
        is_preloaded=bool(more_preload_sentence(allocation)),
        units=allocation.units,
        tradeoff=[(_share(share), rounded_number(cost)) for share, cost in allocation.tradeoff],
        examples=[PARAMETERS[tolerance.name] for tolerance in allocation.priced_dimensions if tolerance.cost.example],
        unmoved=[(PARAMETERS[name], reason) for name, reason in allocation.unmoved_reasons.items()],
        solved=allocation.solved_units,
        pictures=_pictures(allocation, folder),
    )
    write_atomic(folder / "report.html", page.encode())


def _pictures(allocation: Allocation, folder: Path) -> dict[str, Picture]:
    choices = {"before": allocation.stated_choice, "equal": allocation.equal, "found": allocation.cheapest}
    points = {CHOICES[name]: _point(choice) for name, choice in choices.items() if choice is not None}
    figure = tradeoff_figure(allocation.tradeoff, points, allocation.target)
    caption = (
        "The line is the linear model about the best point and was not checked; the points are load-solved units, with "
        "the intervals of their yields. The share of failing units falls to the right."
    )
    return drawn_pictures({"tradeoff": figure}, {"tradeoff": ("Cost against yield", caption)}, folder)


def _point(choice: Choice) -> tuple[float, float, float, float]:
    passing = choice.yield_estimate
    return choice.cost, passing.value, passing.ci_low, passing.ci_high
