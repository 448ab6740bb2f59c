"""What a bench leaves behind: a table and its picture."""

import csv
import io
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.engine.store import write_atomic
from pipeline.figures.style import COLOURS, RULE, line_styles, new_figure, save, with_style

STAGE = "stage_seconds_"
RATES = {
    ("loops_per_second_per_core", ""): "full loops",
    ("metrics_only_per_second_per_core", ""): "metrics only",
    ("unloaded_per_second_per_core", "exact"): "unloaded, exact gaps",
    ("unloaded_per_second_per_core", "first_order"): "unloaded, first order",
}
"""Name and note of the rates that the picture shows."""


@dataclass(frozen=True)
class Result:
    """One row of ``bench.csv``."""

    name: str
    value: float
    unit: str
    samples: int
    jobs: int
    note: str = ""


def write(results: Sequence[Result], folder: Path) -> None:
    """Write ``bench.csv`` and ``figures/bench.png`` and ``.svg``."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([field.name for field in fields(Result)])
    writer.writerows(astuple(result) for result in results)
    write_atomic(folder / "bench.csv", text.getvalue().encode())
    (folder / "figures").mkdir(exist_ok=True)
    save(bench_figure(results), folder / "figures" / "bench")


@with_style
def bench_figure(results: Sequence[Result]) -> Figure:
    """Rates per core against the number of samples, and the seconds of every stage."""
    figure = new_figure(3.4)
    rates, stages = figure.subplots(1, 2)
    for (name, note), style in zip(RATES, line_styles(dict.fromkeys(RATES.values())), strict=True):
        rows = [row for row in results if row.name == name and note in row.note]
        rates.loglog([row.samples for row in rows], [row.value for row in rows], **style)
    rates.set(title="Rates per second and core", xlabel="samples")
    rates.legend(loc="center right", bbox_to_anchor=(1.0, 0.32))
    _stages(stages, [row for row in results if row.name.startswith(STAGE) and row.samples > 1])
    return figure


def _stages(axes: Axes, rows: Sequence[Result]) -> None:
    """Bars of the seconds of the stages, one for every number of samples."""
    sizes = sorted({row.samples for row in rows})
    durations = dict.fromkeys(sizes, 0.0)
    for number, name in enumerate(dict.fromkeys(row.name for row in rows)):
        seconds = {row.samples: row.value for row in rows if row.name == name}
        width = [seconds.get(size, 0.0) for size in sizes]
        colour = COLOURS[number] if number < len(COLOURS) else RULE
        style: dict[str, Any] = {"color": colour, "label": name[len(STAGE) :]}
        axes.barh([f"{size:,}" for size in sizes], width, left=list(durations.values()), **style)
        durations = {size: durations[size] + seconds.get(size, 0.0) for size in sizes}
    axes.set(title="Seconds of the stages", xlabel="s", ylabel="samples")
    axes.legend(loc="lower right")
