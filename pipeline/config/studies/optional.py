"""Optional sections of a study: other forms of the model, and far tails.

Of tails: how many units a rough model looks at, how many are load-solved, and what has no tail.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from pipeline.config.files.section import Section
from pipeline.model.metrics import library

if TYPE_CHECKING:
    from pipeline.config.studies.study import Limits, Samples


class ModelForms(Section):
    """Uncertainty of the model's form: the first `units` of the study are solved again under other forms of the model.

    The forms are every other contact law, the other plane state of stress, a rigid in place of an elastic disk or the
    reverse, and each calibrated number of the design at both ends of its range.
    """

    units: Annotated[int, Field(ge=30, le=100_000)] = 300


class Tails(Section):
    """Yields of parts per million and 99.73 % quantiles.

    A rough model looks at `units`; about `solve` of them, most near a limit, are load-solved beside a pilot.
    """

    units: Annotated[int, Field(ge=1_000, le=10**8)] = 100_000
    solve: Annotated[int, Field(ge=100, le=10**7)] = 4_000


def limited_under_load(limits: Limits) -> dict[str, float]:
    """Limits by metric, of those that have a rough model: rigid bodies need none, metrics of the turn have none."""
    metrics = library()
    return {n: limit for n, limit in limits.of_metrics.items() if n in metrics and not metrics[n].turn_of_rigid_bodies}


def without_tails(samples: Samples, limits: Limits) -> str:
    """Why a study has no far tails; empty if it has."""
    if samples.experiment == "cases":
        return "listed cases are no sample of anything; tails need random samples"
    if not limited_under_load(limits):
        return "[limits] names no metric under load; set one, as lost_motion_arcmin"
    return ""
