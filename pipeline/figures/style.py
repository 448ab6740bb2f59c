"""One look for all figures, and one way to write them.

Colours are Okabe and Ito's, which people with colour-blindness tell apart; lines that share axes differ in their
marker too. The font is the one that Matplotlib brings along, so that a figure has the same bytes on every machine.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec

import matplotlib
import numpy as np
import pandas as pd
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import AutoLocator, MaxNLocator
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

from pipeline.arrays import Real

WIDTH = 9.0
"""Width of a figure [inches]: that of the report's column, so that its 9 points are 12 pixels there."""
PNG_DPI = 160
"""Pixels to an inch: 1440 across the page."""
PNG_COMPRESSION = 3
"""A third larger than the best compression, three times as fast."""

ACROSS = 3
"""Panels side by side."""
MOST_INTERVALS = 8
"""Between ticks; more are slow to draw and make no figure clearer."""

INK, MUTED_INK, RULE = "#1f2933", "#66727f", "#dfe4ea"
ACCENT, ACCENT_LIGHT, ALARM = "#0072b2", "#cfe2f0", "#d55e00"
COLOURS = (ACCENT, ALARM, "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
MARKERS = ("o", "s", "^", "D", "v", "P")

RC: Mapping[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "text.color": INK,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlepad": 8.0,
    "axes.titley": 1.0,  # no ticks stand above; else each title looks for some whenever it is drawn
    "axes.labelcolor": INK,
    "axes.edgecolor": MUTED_INK,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": RULE,
    "grid.linewidth": 0.7,
    "xtick.color": MUTED_INK,
    "ytick.color": MUTED_INK,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "lines.linewidth": 1.5,
    "lines.markersize": 3.5,
    "text.parse_math": False,  # names of materials and labels may hold any character
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "hatch.linewidth": 0.5,
    "figure.constrained_layout.h_pad": 0.06,
    "figure.constrained_layout.w_pad": 0.06,
    "svg.hashsalt": "cycloid",  # else the identifiers in a file are random
}

Arguments = ParamSpec("Arguments")


def with_style(draw: Callable[Arguments, Figure]) -> Callable[Arguments, Figure]:
    """A function that draws its figure in the look of all figures."""

    @wraps(draw)
    def styled_draw(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Figure:
        with rc_context(dict(RC)):
            figure = draw(*args, **kwargs)
            for axes in figure.axes:
                for axis in (axes.xaxis, axes.yaxis):
                    locator = axis.get_major_locator()
                    if isinstance(locator, AutoLocator):
                        locator.set_params(nbins=MOST_INTERVALS)
            return figure

    return styled_draw


class _SteadyAxes(Axes):
    """Axes with as many ticks in any size, so that what stands beside them needs the same room wherever they lie.

    The layout asks for that room before and after it moves them: the second answer follows from the first.
    """

    _margins: Real | None = None

    def get_tightbbox(self, renderer: Any = None, *, for_layout_only: bool = False, **options: Any) -> Bbox | None:
        """Box of the axes and what stands beside them [pixels]."""
        if not for_layout_only or self.get_aspect() != "auto":
            return super().get_tightbbox(renderer, for_layout_only=for_layout_only, **options)
        if self._margins is not None:
            box, self._margins = self.get_window_extent(renderer).get_points() + self._margins, None
            return Bbox(box)
        outer = super().get_tightbbox(renderer, for_layout_only=True, **options)
        if outer is not None:
            self._margins = outer.get_points() - self.get_window_extent(renderer).get_points()
        return outer


class _SteadyFigure(Figure):
    """A figure of steady axes."""

    def add_subplot(self, *arguments: Any, **options: Any) -> Any:
        """Add axes as `Figure.add_subplot` does."""
        return super().add_subplot(*arguments, **{"axes_class": _SteadyAxes} | options)


def new_figure(height: float, width: float = WIDTH) -> Figure:
    """Empty figure [inches], drawn without a display."""
    figure = _SteadyFigure(figsize=(width, height), dpi=PNG_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def panel_grid(count: int, base: float, row: float, *, sharey: bool = False) -> tuple[Figure, NDArray[Any]]:
    """An empty figure with ``count`` axes, three side by side, ``base`` and ``row`` inches high for each row."""
    rows = -(-count // ACROSS)
    figure = new_figure(base + row * rows)
    panels = figure.subplots(rows, min(count, ACROSS), squeeze=False, sharey=sharey).ravel()
    for axes in panels[count:]:
        axes.set_axis_off()
    return figure, panels


def paired_panels(count: int, row: float, across: int = 2) -> tuple[Figure, NDArray[Any]]:
    """A figure with ``count`` axes, two side by side, ``row`` inches high for each row; what is left is empty."""
    rows = -(-count // across)
    figure = new_figure(row * rows)
    panels = figure.subplots(rows, across, squeeze=False).ravel()
    for axes in panels[count:]:
        axes.set_visible(False)
    return figure, panels[:count]


def save(figure: Figure, stem: Path) -> None:
    """Write ``stem``.png and ``stem``.svg; equal figures give equal bytes.

    The canvases print on their own: `Figure.savefig` draws every figure once more to learn its size.
    """
    with rc_context(dict(RC)):  # ticks come into being when they are drawn
        FigureCanvasAgg(figure).print_png(
            stem.with_suffix(".png"), metadata={"Software": None}, pil_kwargs={"compress_level": PNG_COMPRESSION}
        )
        figure.set_layout_engine("none")  # the layout is found; finding it again would take as long as drawing
        FigureCanvasSVG(figure).print_svg(stem.with_suffix(".svg"), metadata={"Date": None, "Creator": None})


def line_styles(labels: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Colour, marker and label of each line that stands for a case."""
    for number, label in enumerate(labels):
        yield {
            "color": COLOURS[number % len(COLOURS)],
            "marker": MARKERS[number % len(MARKERS)],
            "markersize": max(5.0 - 0.8 * number, 3.0),  # a later marker leaves an earlier one below it in sight
            "label": label,
        }


def rising_styles(labels: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Colour, marker and label of each line of a rising quantity, light to dark."""
    shades = matplotlib.colormaps["Blues"](np.linspace(0.4, 1.0, max(len(labels), 2)))
    for number, label in enumerate(labels):
        yield {"color": shades[number], "marker": MARKERS[number % len(MARKERS)], "label": label}


def pin_axis(axes: Axes) -> None:
    """Horizontal axis of pin numbers."""
    axes.set_xlabel("pin number")
    axes.xaxis.set_major_locator(MaxNLocator(nbins=10, integer=True, steps=[1, 2, 5, 10]))


def write_beside(axes: Axes, text: str, point: tuple[float, float], offset: tuple[float, float], **style: Any) -> None:
    """A small text, ``offset`` points of type away from a point of the axes."""
    small: dict[str, Any] = {"fontsize": 8}
    axes.annotate(text, point, offset, textcoords="offset points", **small | style)


def draw_band(axes: Axes, x: pd.Series, spread: pd.DataFrame, band: str | None, median: str | None) -> None:
    """What lies between ``low`` and ``high`` of a spread, and its ``middle`` dashed, each with its label."""
    axes.fill_between(x, spread["low"], spread["high"], color=ACCENT_LIGHT, linewidth=0, label=band)
    axes.plot(x, spread["middle"], "--", color=INK, linewidth=1.0, label=median)


def legend_below(figure: Figure | SubFigure, axes: Axes) -> None:
    """Legend of the lines of ``axes`` under the whole figure, where it covers nothing and takes no width."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 5), columnspacing=1.6)
