"""The page on the cheapest tolerances at a wanted yield."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from pipeline.config.studies.study import ALL_LIMITS
from pipeline.decisions.allocation.allocate import Allocation, Choice
from pipeline.decisions.allocation.results import allocation_rows, check_rows
from pipeline.engine.store import write_atomic
from pipeline.figures.decisions import tradeoff_figure
from pipeline.figures.labels import METRICS, PARAMETERS
from pipeline.report.layout.rendering import Picture, drawn_pictures, render
from pipeline.report.layout.wording import rounded_number

TEMPLATE = "decisions/allocation.html"
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
            f"{_yield(cheapest)} "
            f"and cost {cheapest.cost:.3g}; those of the study give {_yield(stated_choice)} and cost "
            f"{stated_choice.cost:.3g}. Most "
            f"failing units break {allocation.hardest_limit}: loosen this limit, change an allowance, or state the "
            "cost of further tolerances."
        )
    text = (
        f"The cheapest tolerances found for a yield of {_share(allocation.target)} cost {cheapest.cost:.3g} and give "
        f"{_yield(cheapest)}; those of the study cost {stated_choice.cost:.3g} and give {_yield(stated_choice)}."
    )
    if allocation.equal is None:
        return f"{text} Scaling all priced tolerances alike does not reach the target."
    saving = 1 - cheapest.cost / allocation.equal.cost
    return (
        f"{text} Scaling all of them alike costs {allocation.equal.cost:.3g} and gives {_yield(allocation.equal)}: the "
        f"allocation is {100 * saving:.1f} % {'cheaper' if saving >= 0 else 'dearer'}."
    )


def _yield(choice: Choice) -> str:
    estimate = choice.yield_estimate
    interval = f"{100 * estimate.ci_low:.1f} to {_share(estimate.ci_high)}"
    return f"{_share(estimate.value)} ({interval}, {estimate.n:,} new units)"


def _share(value: float) -> str:
    return f"{100 * value:.1f} %"


def write_allocation_page(allocation: Allocation, file: str, folder: Path) -> None:
    """Write report.html and its figure into ``folder``; ``file`` names the study file beside it."""
    rows = pd.DataFrame(allocation_rows(allocation)).to_dict("records")
    checks = pd.DataFrame(check_rows(allocation)).to_dict("records")
    page = render(
        TEMPLATE,
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
                "n": f"{row['n']:,}",
                "cost": rounded_number(row["cost"]),
            }
            for row in checks
        ],
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
