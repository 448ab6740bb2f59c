"""Rates, confusion table and its picture, beside the table of the cases."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pipeline.figures.style import INK, new_figure, save, with_style
from pipeline.identification.selection.criteria import LARGEST_CLASS
from tests.validation.blind.generate import TWO
from tests.validation.blind.rates import confusion, rates, write_confusion, write_rates
from tests.validation.blind.run import Row


def write_reports(rows: Sequence[Row], folder: Path) -> None:
    """rates.csv, confusion.csv and figures/confusion in the run's folder."""
    write_rates(folder / "rates.csv", rates(rows))
    write_confusion(folder / "confusion.csv", confusion(rows))
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    save(confusion_figure(rows), folder / "figures" / "confusion")


def _truth(row: Row) -> str:
    return "two effects" if row.kind == TWO else row.truth


def _said(row: Row) -> list[str]:
    """The names over which a case's count is shared."""
    if not row.named:
        return [row.verdict]
    return row.named.split(";") if row.class_size <= LARGEST_CLASS else ["unresolved"]


@with_style
def confusion_figure(rows: Sequence[Row]) -> Figure:
    """Truth against what was named; a case whose class has n members counts 1/n for each."""
    truths = sorted({_truth(row) for row in rows}, key=lambda name: (name != "none", ":" in name, name))
    answers = sorted(
        {name for row in rows for name in _said(row)}, key=lambda name: (name in truths, name), reverse=True
    )
    counts = np.zeros((len(truths), len(answers)))
    for row in rows:
        names = _said(row)
        for name in names:
            counts[truths.index(_truth(row)), answers.index(name)] += 1 / len(names)
    figure = new_figure(1.6 + 0.24 * len(truths), 2.5 + 0.32 * len(answers))
    axes = figure.add_subplot()
    axes.grid(visible=False)
    axes.imshow(counts, cmap="Blues", vmin=0, vmax=max(1.5 * counts.max(), 1), aspect="auto")
    for i, j in zip(*np.nonzero(counts), strict=True):
        axes.text(j, i, f"{counts[i, j]:.2g}", ha="center", va="center", color=INK, fontsize=7.5)
    axes.set_xticks(range(len(answers)), answers, rotation=60, ha="right")
    axes.set_yticks(range(len(truths)), truths)
    axes.set_xlabel("named, or the verdict where nothing was")
    axes.set_ylabel("truth")
    axes.set_title("What was there and what was named, cases")
    return figure
