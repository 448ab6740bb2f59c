"""Templates to pages that need nothing beside them, and figures as pictures in them."""

from __future__ import annotations

import base64
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from jinja2.utils import Namespace

from pipeline.report.layout.wording import count_text, listed_text, plain_number

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


REPORT = Path(__file__).parents[1]
LAYOUT = REPORT / "layout"
NUMBER_AND_UNIT = re.compile(r"(\d) (%|N m\b|mm\b|µm\b|MPa\b|arcmin\b)")
"""What a line must not break between."""


def environment(folder: Path, filters: Mapping[str, Callable[..., str]] | None = None) -> Environment:
    """Templates of a folder and of this package, of one page: its figures are counted through.

    Parameters
    ----------
    folder : of the templates, which may extend and import those of this package.
    filters : further filters of the templates, by name.
    """
    templates = Environment(
        loader=FileSystemLoader([folder, LAYOUT, REPORT]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters |= {"plain": plain_number, "listed": listed_text, "counted": count_text, **(filters or {})}
    templates.globals["numbering"] = Namespace(figure=0)
    return templates


def one_file(templates: Environment, name: str, **values: object) -> str:
    """A template as one HTML document; numbers do not part from their units."""
    return NUMBER_AND_UNIT.sub("\\1\u00a0\\2", templates.get_template(name).render(**values))


def render(template: str | Path, filters: Mapping[str, Callable[..., str]] | None = None, **values: object) -> str:
    """A template as one HTML document.

    Parameters
    ----------
    template : of this package by its name, or a file elsewhere, which may extend and import those of this package.
    filters : further filters of the template, by name.
    values : what the template is filled with.
    """
    file = REPORT / template
    return one_file(environment(file.parent, filters), file.name, **values)
