"""The answer first: a card for each limit, which limit fails and why, and what the yield holds for."""

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.config.studies.study import ALL_LIMITS
from pipeline.figures.samples.failures import failures_figure
from pipeline.report.drawing import Drawing
from pipeline.report.frames import Frames
from pipeline.report.results import Results
from pipeline.report.samples.model_forms import FormResults
from pipeline.report.sections.section import Page, Section
from pipeline.report.verdict import Verdict


def _values(page: Page) -> Mapping[str, object]:
    forms = FormResults(page.frames, page.results)
    return {
        "verdict": Verdict(page.frames, page.results),
        "as_stated": forms.yield_range(rescaled=False),
        "rescaled": forms.yield_range(rescaled=True),
    }


def _drawings(frames: Frames) -> Iterator[Drawing]:
    breaks = dict(Verdict(frames, Results(frames)).breaks)
    failing = breaks.pop(ALL_LIMITS, np.zeros(0, bool))
    if failing.any():
        yield Drawing(
            "failures",
            "Limits that the failing units break",
            f"Share of {len(failing):,} units; a unit that breaks two limits counts in both bars.",
            partial(failures_figure, breaks),
        )


SECTION = Section(
    name="summary",
    title="Summary",
    rank=5,
    template=Path(__file__).with_suffix(".html"),
    values=_values,
    applies=lambda frames: not frames.listed and len(frames.over_turn) > 0,
    drawings=_drawings,
)
