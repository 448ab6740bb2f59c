"""Templates to pages that need nothing beside them."""

import base64
import re
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from pipeline.report.wording import counted, listed, plain

NUMBER_AND_UNIT = re.compile(r"(\d) (%|N m\b|mm\b|µm\b|MPa\b|arcmin\b)")
"""What a line must not break between."""


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


def rendered(template: str, **values: object) -> str:
    """A template of this package as one HTML document; numbers do not part from their units."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"plain": plain, "listed": listed, "counted": counted}
    return NUMBER_AND_UNIT.sub("\\1\u00a0\\2", environment.get_template(template).render(**values))
