"""A generated unit as files: what a bench leaves behind, and the sealed truth apart from it."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.arrays import Real
from pipeline.config.changing import toml_of
from pipeline.config.dimensions import dimension_library
from pipeline.config.studies.study import Study
from pipeline.sampling.errors import Errors
from tests.validation.blind.bench import Bench, quantised

Reading = Callable[[Real, float, float, np.random.Generator], Real]
"""Angles, standard deviation of their noise, step and random numbers to what is read."""

DIMENSION_STEP_UM = 0.1
"""Step of a dimension as a measuring report states it [um]."""
_INSPECTED = [
    dimension
    for dimension in dimension_library().values()
    if not (dimension.acts_on or dimension.counted_where_varied) and dimension.fewest_disks <= 1
]
DIMENSIONS = tuple(dimension.name for dimension in sorted(_INSPECTED, key=lambda dimension: dimension.elements is None))
"""What an inspection of a reducer with one disk measures, elements before the rest; what acts through another dimension
is part of that, and what no blind unit varies is left out."""


def write_unit(
    folder: Path,
    study: Study,
    bench: Bench,
    angles: Sequence[Real],
    noise: tuple[float, float],
    rng: np.random.Generator,
    dimensions: Errors | None,
    measuring_um: float,
    reading: Reading | None = None,
) -> None:
    """data.csv, unit.toml, the study's files and, where the dimensions are known, dims.toml.

    Parameters
    ----------
    angles : per position (n_rows,) [arcmin] without noise and offset.
    noise : standard deviation of a row's angle and resolution of the angle [arcmin].
    dimensions : one sample [um], or None where they are unknown.
    measuring_um : standard deviation of what is written of them, of the part that all of a kind share and of each.
    reading : what the encoder makes of the angle; ``rounded`` unless another is given.
    """
    folder.mkdir(parents=True, exist_ok=True)
    design = study.design.model_dump(mode="json")
    settings = study.model_dump(mode="json", exclude={"name", "design", "cases"})
    (folder / "design.toml").write_text(toml_of(design), encoding="utf-8")
    (folder / "study.toml").write_text(toml_of({**settings, "design": "design.toml"}), encoding="utf-8")
    measured_table(bench, angles, noise, rng, reading or rounded).to_csv(folder / "data.csv", index=False)
    if dimensions is not None:
        (folder / "dims.toml").write_text(toml_of(_measured(dimensions, measuring_um, rng)), encoding="utf-8")
    unit = {
        "title": f"blind unit {folder.name}",
        "design": "design.toml",
        "study": "study.toml",
        "locked": bench.locked,
        "offset": "common" if bench.common else "per_position",
        "as_measured": "unknown" if dimensions is None else "dims.toml",
        "instrument": {"angle_resolution_arcmin": noise[1], "torque_resolution_Nm": bench.torque_step},
    }
    (folder / "unit.toml").write_text(toml_of(unit), encoding="utf-8")


def rounded(angle: Real, deviation: float, step: float, rng: np.random.Generator) -> Real:
    """Angles (n_rows,) as read: white noise, rounded to whole steps."""
    return quantised(angle + deviation * rng.standard_normal(len(angle)), step)


def measured_table(
    bench: Bench, angles: Sequence[Real], noise: tuple[float, float], rng: np.random.Generator, reading: Reading
) -> pd.DataFrame:
    """Rows as the bench writes them, with offset, noise and quantisation."""
    parts = []
    for crank, ramp, offset, angle in zip(bench.cranks, bench.ramps, bench.offset, angles, strict=True):
        n = len(angle)
        read = reading(angle + offset, *noise, rng)
        torque = quantised(ramp.torque + bench.torque_noise * rng.standard_normal(n), bench.torque_step)
        columns = {"cycle": ramp.cycle, "crank_deg": crank, "torque_Nm": np.round(torque, 9)}
        columns["angle_arcmin"] = np.round(read, 9)
        if bench.timed:
            columns["time_s"] = np.round(ramp.begin + ramp.time, 4)
        if bench.warmed:
            warm = ramp.temperature[ramp.cycle] + 0.1 * rng.standard_normal(n)
            columns["temperature_C"] = np.round(warm, 2)
        parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


def _measured(dimensions: Errors, measuring_um: float, rng: np.random.Generator) -> dict[str, Any]:
    """As-measured dimensions [um] with the errors of measuring, rounded as an inspection report is."""
    collected = {}
    for name in DIMENSIONS:
        true = getattr(dimensions, name)[0]
        deviation = rng.standard_normal() + (rng.standard_normal(np.shape(true)) if np.ndim(true) else 0.0)
        measured = true + measuring_um * deviation if name != "bearing_clearance" else true
        value = np.round(measured / DIMENSION_STEP_UM) * DIMENSION_STEP_UM
        collected[name] = np.round(np.atleast_1d(value), 3).tolist() if np.ndim(value) else round(float(value), 3)
    return collected


def write_truth(path: Path, truth: Mapping[str, Any]) -> None:
    """The sealed truth."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(truth, indent=1, sort_keys=True) + "\n", encoding="utf-8")
