"""Which other forms of the model a study is computed with, beside its own."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from pipeline.config.files.section import Section


class ModelForms(Section):
    """Uncertainty of the model's form: the first `units` of the study are solved again under other forms of the model.

    The forms are every other contact law, the other plane state of stress, a rigid in place of an elastic disk or the
    reverse, and each calibrated number of the design at both ends of its range.
    """

    units: Annotated[int, Field(ge=30, le=100_000)] = 300
