"""What every page looks like: its frame, its style, and how templates become pages.

Templates to pages that need nothing beside them, and figures as pictures in them.

Numbers as the report writes them: their digits, their intervals, and what the samples do not determine.
"""

import base64
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from jinja2.utils import Namespace

from pipeline.model.metrics import Quantity, signed_number

if TYPE_CHECKING:
    from matplotlib.figure import Figure


DASH = "\u2013"
"""En dash: no value, or an end of an interval that the samples do not determine."""
UNDETERMINED_TEXT = "not determined"

SHARE = Quantity("Share of units", "%", 1)
FINEST_SHARE = 4
"""Decimals of a share in percent at most: parts per million."""


def number(value: float, quantity: Quantity) -> str:
    """The value with the quantity's digits; an en dash for none."""
    return quantity.text(value) if math.isfinite(value) else DASH


def interval(low: float, high: float, quantity: Quantity) -> str:
    """A confidence interval; an en dash stands for an undetermined end."""
    if not (math.isfinite(low) or math.isfinite(high)):
        return UNDETERMINED_TEXT
    return f"{number(low, quantity)} to {number(high, quantity)}"


def percent(share: float) -> str:
    """A share in percent, with its sign."""
    return f"{_percentage(share)} %" if math.isfinite(share) else DASH


def _percentage(share: float) -> str:
    """A share in percent without its sign; one that is neither 0 nor 1 is not rounded to either."""
    decimals = SHARE.decimals
    while 0 < share < 1 and round(100 * share, decimals) in (0, 100) and decimals < FINEST_SHARE:
        decimals += 1
    return SHARE.text(100 * share) if decimals == SHARE.decimals else signed_number(100 * share, decimals)


def percent_interval(low: float, high: float) -> str:
    """A confidence interval of a share in percent."""
    if not (math.isfinite(low) or math.isfinite(high)):
        return UNDETERMINED_TEXT
    return f"{' to '.join(_percentage(end) if math.isfinite(end) else DASH for end in (low, high))} %"


def plain_number(value: float | int) -> str:
    """A setting as it was typed, with grouped digits."""
    return f"{value:,.10g}".replace("-", "\u2212")


def rounded_number(value: float) -> str:
    """A number with three significant digits and grouped thousands; an en dash for none."""
    return plain_number(float(f"{value:.3g}")) if math.isfinite(value) else DASH


def count_text(count: int, singular: str, plural: str | None = None) -> str:
    """``1 sample``, ``2,000 samples``."""
    return f"{count:,} {singular if count == 1 else plural or singular + 's'}"


def listed_text(texts: Sequence[str], conjunction: str = "and") -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} {conjunction} {texts[-1]}" if texts else DASH


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


def drawn_picture(figure: "Figure", title: str, caption: str, stem: Path) -> Picture:
    """The figure for a page, written as ``stem``.png and ``stem``.svg too."""
    from pipeline.figures.style import save  # what only shows pictures does not wait for a plotting library

    stem.parent.mkdir(parents=True, exist_ok=True)
    save(figure, stem)
    return written_picture(title, caption, stem)


def written_picture(title: str, caption: str, stem: Path) -> Picture:
    """The figure for a page that was written as ``stem``.svg."""
    return Picture(title, caption, stem.with_suffix(".svg").read_bytes())


def drawn_pictures(
    figures: "Mapping[str, Figure]", captions: Mapping[str, tuple[str, str]], folder: Path
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
