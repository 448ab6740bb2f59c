"""Figures as files beside a page, and as pictures that stand in it."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Picture:
    """A figure as it stands in the page: its title, caption, and SVG file."""

    title: str
    caption: str
    svg: bytes

    @property
    def source(self) -> str:
        """The file as an address that holds the file itself."""
        return f"data:image/svg+xml;base64,{base64.b64encode(self.svg).decode()}"


@dataclass(frozen=True)
class LinkedPicture:
    """A figure that a page names by its address until it is drawn: its title, caption, and that of its SVG file."""

    title: str
    caption: str
    source: str


def with_pictures(page: str, pictures: Iterable[LinkedPicture], folder: Path) -> str:
    """The page with the files of the folder themselves in place of their addresses."""
    for picture in pictures:
        svg = (folder / picture.source).read_bytes()
        page = page.replace(f'src="{picture.source}"', f'src="{Picture(picture.title, picture.caption, svg).source}"')
    return page


def drawn_picture(figure: Figure, title: str, caption: str, stem: Path) -> Picture:
    """The figure for a page, written as ``stem``.png and ``stem``.svg too."""
    from pipeline.figures.style import save  # what only shows pictures does not wait for a plotting library

    stem.parent.mkdir(parents=True, exist_ok=True)
    save(figure, stem)
    return written_picture(title, caption, stem)


def written_picture(title: str, caption: str, stem: Path) -> Picture:
    """The figure for a page that was written as ``stem``.svg."""
    return Picture(title, caption, stem.with_suffix(".svg").read_bytes())


def drawn_pictures(
    figures: Mapping[str, Figure], captions: Mapping[str, tuple[str, str]], folder: Path
) -> dict[str, Picture]:
    """Each figure by its name, with its title and caption, written into the folder's ``figures`` too."""
    return {name: drawn_picture(figure, *captions[name], folder / "figures" / name) for name, figure in figures.items()}
