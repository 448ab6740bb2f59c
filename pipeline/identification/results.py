"""What an identification leaves behind: its tables, the verdict, the page, and the corrected design and study."""

from __future__ import annotations

from pathlib import Path

from pipeline.engine.store import write_json
from pipeline.identification.identify import Identification


def write(found: Identification, folder: Path) -> None:
    """Write all results of an identification into ``folder``."""
    write_json(folder / "verdict.json", {"unit": found.unit.name, "verdict": found.verdict.verdict})
