"""The answer first: a card for each limit, which limit fails and why, and what the yield holds for."""

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.config.studies.study import ALL_LIMITS
from pipeline.figures.yields import failures_figure
from pipeline.report.drawing import Drawing
from pipeline.report.frames import Frames
from pipeline.report.model_forms import FormResults
from pipeline.report.results import Results
from pipeline.report.sections.section import Page, Section
from pipeline.report.single_changes import SCALED_YIELDS, SingleChanges
from pipeline.report.verdict import Verdict


def _values(page: Page) -> Mapping[str, object]:
    forms = FormResults(page.frames, page.results)
    return {
        "verdict": Verdict(page.frames, page.results),
        "changes": SingleChanges.from_frames(page.frames, page.results.estimate(ALL_LIMITS, "yield")),
        "as_stated": forms.yield_range(is_rescaled=False),
        "rescaled": forms.yield_range(is_rescaled=True),
    }


def _drawings(frames: Frames) -> Iterator[Drawing]:
    results = Results(frames)
    breaks = dict(Verdict(frames, results).breaks)
    failing = breaks.pop(ALL_LIMITS, np.zeros(0, bool))
    if failing.any():
        changes = SingleChanges.from_frames(frames, results.estimate(ALL_LIMITS, "yield"))
        curves = changes.curves()
        scaled_yields = (
            " Right: estimated yield against all limits if one tolerance alone is scaled, the five of the widest span; "
            "the band is the interval of the first, the dotted line is the next target."
        )
        yield Drawing(
            "failures",
            "Limits that the failing units break, and the yield against the scale of each tolerance"
            if curves
            else "Limits that the failing units break",
            f"{'Left: share' if curves else 'Share'} of {len(failing):,} units; a unit that breaks two limits counts "
            f"in both bars.{scaled_yields if curves else ''}",
            partial(failures_figure, breaks, curves, changes.target),
        )


SECTION = Section(
    name="summary",
    title="Summary",
    rank=5,
    template=Path(__file__).with_suffix(".html"),
    values=_values,
    applies=lambda frames: not frames.is_listed and len(frames.over_turn) > 0,
    drawings=_drawings,
    tables=(SCALED_YIELDS,),
)
