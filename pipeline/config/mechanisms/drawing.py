"""What an output mechanism has drawn of itself: circles, points and texts in panels [mm, housing frame]."""

from dataclasses import dataclass
from typing import Literal

from pipeline.arrays import Complex

Part = Literal["disk", "output", "between"]
"""Whose outline a circle is, or whose text: of the disk, of the output, or of a body between them."""


@dataclass(frozen=True)
class Circles:
    """Circles of one radius about the centres (n,) complex, and a text within each."""

    centre: Complex
    radius: float
    part: Part
    texts: tuple[str, ...] = ()
    text_size: float = 7.0


@dataclass(frozen=True)
class Points:
    """Points (n,) complex that are marked."""

    point: Complex


@dataclass(frozen=True)
class RowLabel:
    """A text at the end of a row that runs in a direction: it is written along the row, away from it."""

    point: complex
    direction: complex
    text: str
    part: Part


@dataclass(frozen=True)
class Panel:
    """One drawing of a part of the mechanism.

    Attributes
    ----------
    shapes : from the back to the front.
    reach : half of its width, None to show the whole disk.
    disk : whether the disk stands behind the shapes.
    """

    title: str
    shapes: tuple[Circles | Points | RowLabel, ...]
    reach: float | None = None
    disk: bool = False
