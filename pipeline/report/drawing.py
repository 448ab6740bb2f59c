"""What the report knows of a figure."""

from dataclasses import dataclass

from matplotlib.figure import Figure


@dataclass(frozen=True)
class Drawing:
    """One figure of the report; `name` is the stem of its files and its place in the page."""

    name: str
    title: str
    caption: str
    figure: Figure
