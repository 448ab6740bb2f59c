"""The page on which measured parts to put together."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.config.studies.study import Study
from pipeline.decisions.selective_assembly import DRAWS, Assembly, pair_rows
from pipeline.engine.store import write_atomic
from pipeline.figures.decisions import margins_figure
from pipeline.report.layout.rendering import drawn_picture, render
from pipeline.report.layout.wording import rounded_number
from pipeline.statistics.intervals import Estimate

TEMPLATE = "decisions/assembly.html"
SHOWN_PAIRS = 30
"""Pairs of the page, those with the smallest margins."""


def is_difference_shown(assembly: Assembly) -> bool:
    """Whether the intervals of the two yields do not overlap."""
    chosen, random = assembly.selected_yield, assembly.random
    return chosen.ci_low > random.ci_high or random.ci_low > chosen.ci_high


def next_step(assembly: Assembly) -> str:
    """What to do with the assignment."""
    if assembly.selected_yield.value > assembly.random.value and is_difference_shown(assembly):
        return "Assemble the pairs of pairs.csv, and measure the units of the pairs with the smallest margins."
    return (
        "Assemble at random, or measure more dimensions of the parts, those with the largest share of the variance "
        "first, and repeat the command."
    )


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
    return f"{100 * share.value:.3g} % (95 % CI {100 * share.ci_low:.3g} to {100 * share.ci_high:.3g})"


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
        TEMPLATE,
        study=study,
        first=assembly.first_lot.name,
        second=assembly.second_lot.name,
        sentences=assembly_sentences(assembly, mounting_limit),
        next_step=next_step(assembly),
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
