"""The answer first: a card for each limit, which limit fails and why, and what the yield holds for."""

from collections.abc import Mapping
from pathlib import Path

from pipeline.report.sections.section import Page, Section
from pipeline.report.verdict import Verdict


def _values(page: Page) -> Mapping[str, object]:
    return {"verdict": Verdict(page.frames, page.results)}


SECTION = Section(
    name="summary",
    title="Summary",
    rank=5,
    template=Path(__file__).with_suffix(".html"),
    values=_values,
    applies=lambda frames: not frames.listed and len(frames.over_turn) > 0,
)
