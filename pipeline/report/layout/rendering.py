"""Templates to pages that need nothing beside them."""

import re
from collections.abc import Callable, Mapping
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from jinja2.utils import Namespace

from pipeline.report.layout.wording import count_text, listed_text, plain_number

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
