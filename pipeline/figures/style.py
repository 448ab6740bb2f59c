"""One look for all figures, and one way to write them."""

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

PNG_DPI = 160


def new_figure(width: float = 7.0, height: float = 4.2) -> Figure:
    """Empty figure [inches], drawn without a display."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, stem: Path) -> None:
    """Write ``stem``.png and ``stem``.svg; equal figures give equal bytes."""
    figure.savefig(stem.with_suffix(".png"), dpi=PNG_DPI, metadata={"Software": None})
    figure.savefig(stem.with_suffix(".svg"), metadata={"Date": None, "Creator": None})
