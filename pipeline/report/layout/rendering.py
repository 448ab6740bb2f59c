"""Templates to pages that need nothing beside them."""

import re
from collections.abc import Callable, Mapping
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from pipeline.report.layout.wording import counted, listed, plain

REPORT = Path(__file__).parents[1]
LAYOUT = REPORT / "layout"
NUMBER_AND_UNIT = re.compile(r"(\d) (%|N m\b|mm\b|µm\b|MPa\b|arcmin\b)")
"""What a line must not break between."""


def rendered(template: str | Path, filters: Mapping[str, Callable[..., str]] | None = None, **values: object) -> str:
    """A template as one HTML document; numbers do not part from their units.

    Parameters
    ----------
    template : of this package by its name, or a file elsewhere, which may extend and import those of this package.
    filters : further filters of the template, by name.
    values : what the template is filled with.
    """
    file = REPORT / template
    environment = Environment(
        loader=FileSystemLoader([file.parent, LAYOUT, REPORT]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"plain": plain, "listed": listed, "counted": counted, **(filters or {})}
    return NUMBER_AND_UNIT.sub("\\1\u00a0\\2", environment.get_template(file.name).render(**values))
