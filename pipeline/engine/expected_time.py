"""How long a stage is expected to take: by an earlier run, else by the calibrated time of a unit."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline.engine.cache import Cache
from pipeline.engine.fingerprint import fingerprint
from pipeline.engine.stage import Job, Sections, Stage
from pipeline.engine.store import Output

LEAST_SHARE = 0.1
"""Share of the work that a run must have had for its time to be scaled: a small run is mostly its beginning."""


def expected_seconds(stage: Stage, study: Any, runs: Path) -> float | None:
    """Seconds of a stage by a record of this run, or the latest of any other, in proportion to its items and settings.

    Without a record, by the calibrated time of one unit; None for a stage that has none.
    """
    folders = [runs / study.name, *(path for path in runs.glob("[!.]*") if path.name != study.name)]
    records = [output.record for folder in folders if (output := Output.open(folder / stage.name))]
    records[1:] = sorted(records[1:], key=lambda record: record["started"], reverse=True)
    settings = fingerprint(stage, study, {}).settings
    job = Job(Sections(study, (*stage.sections, "name")), 1, runs, {}, Cache(runs / ".cache", ""))
    units = _units(stage, settings, stage.items(job) if stage.items else 1)
    for record in records:
        former_units = _units(stage, record["settings"], record.get("items", 0) if stage.items else 1)
        is_comparable = former_units and _optional(record["settings"]) == _optional(settings)
        if is_comparable and former_units >= LEAST_SHARE * units:
            return float(record["seconds"]) * units / former_units
    return stage.unit_seconds * units if stage.unit_seconds else None


def _units(stage: Stage, settings: Mapping[str, Any], items: int) -> float:
    """Product of the items and of the settings that the time of a stage is proportional to."""
    sizes = [settings.get(name) for name in stage.proportional_to]
    return float(items * math.prod(len(size) if isinstance(size, Sequence) else size for size in sizes if size))


def _optional(settings: Mapping[str, Any]) -> frozenset[str]:
    """Settings without a value: a run that had none of a section did not do its work."""
    return frozenset(name for name, value in settings.items() if value is None)
