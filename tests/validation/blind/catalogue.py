"""The catalogue of reducers that blind units are drawn from: what the model believes, and what generates the data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from pipeline import assembly
from pipeline.arrays import Real
from pipeline.config import Study, load_study, parse_study
from pipeline.config.designs.design import Design
from pipeline.config.reading import parse_design
from pipeline.engine.runner import Resources, run
from stages.chain import STAGES
from stages.tables.condensed import COMPLIANCE_FILE, full_compliance

UNCERTAIN = ("bearing.stiffness_N_per_mm_power", "disk.thickness_mm", "output.roller_length_mm")
"""Numbers that the model must calibrate."""
OFF = 1.05, 1.2
"""Factors by which the truth of such a number is off, at least and at most, up or down."""
PLAUSIBLE = 1.25
"""Factor of the plausible range that is stated with them."""
CRANKS_A_DESIGN = 6
"""Crank angles [deg] at which units of one design may be measured; each is condensed once."""
OTHER_LAW = "palmgren"
"""Of the generator; the model's studies take Hertz."""

PLATE_49: Mapping[str, Any] = {
    "title": "Roller-plate reducer, ratio 49",
    "cycloid": {
        "pins": 50,
        "pin_radius_mm": 1.6,
        "pin_circle_radius_mm": 45.0,
        "eccentricity_mm": 0.5,
        "rated_torque_Nm": 30.0,
    },
    "housing": {"outer_diameter_mm": 98.0},
    "disk": {"thickness_mm": 2.0, "bore_radius_mm": 4.5},
    "output": {
        "rollers": 32,
        "roller_radius_mm": 2.0,
        "roller_length_mm": 4.0,
        "inner_station_mm": 7.0,
        "outer_station_mm": 26.0,
        "face_offset_mm": 7.0,
        "flat_depth_mm": 7.0,
    },
}
HOLES_19: Mapping[str, Any] = {
    "title": "Reducer with six pins in holes, ratio 19",
    "cycloid": {
        "pins": 20,
        "pin_radius_mm": 2.5,
        "pin_circle_radius_mm": 35.0,
        "eccentricity_mm": 1.0,
        "rated_torque_Nm": 60.0,
    },
    "housing": {"outer_diameter_mm": 86.0},
    "disk": {"thickness_mm": 8.0, "bore_radius_mm": 11.0},
    "bearing": {"stiffness_N_per_mm_power": 250000.0},
    "output": {"pins": 6, "pin_radius_mm": 3.5, "pin_circle_radius_mm": 21.0, "hole_clearance_um": 4.0},
}


@dataclass(frozen=True)
class CatalogueReducer:
    """One reducer of the catalogue.

    Attributes
    ----------
    name : of its folder.
    model : study that the identification is given.
    truth : study that generates: finer mesh, other patches, other contact law.
    """

    name: str
    model: Study
    truth: Study

    @property
    def rigid_model(self) -> Study:
        """What the identification is given of a unit that the second simulator made: its disk is known to be rigid."""
        return _rigid(self.model)

    @property
    def rigid_truth(self) -> Study:
        """The nearest that the model comes to the second simulator: a rigid disk and Palmgren's law."""
        return _rigid(self.model, OTHER_LAW)

    @property
    def cranks(self) -> tuple[float, ...]:
        """Crank angles [deg] that are condensed."""
        return self.model.cycle.crank_deg


@dataclass(frozen=True)
class CataloguedCompliances:
    """Compliances of a study at its crank angles, from the file that the stage `reduce` wrote."""

    path: Path

    def __call__(self, study: Study, cranks: Sequence[float]) -> list[Real]:
        return [full_compliance(self.path, assembly.reducer(study.design, crank), crank) for crank in cranks]


def no_compliance(study: Study, cranks: Sequence[float]) -> list[Real]:
    """Compliances of a study whose disk is rigid."""
    counts = [len(assembly.reducer(study.design, crank).contacts) for crank in cranks]
    return [np.zeros((count, count)) for count in counts]


def _rigid(study: Study, law: str | None = None) -> Study:
    """The study with a rigid disk and, where one is named, another contact law."""
    return study.with_section("reduce", disk="rigid").with_section("springs", law=law or study.springs.law)


def _merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in changes.items():
        merged[key] = _merged(base[key], value) if isinstance(value, Mapping) else value
    return merged


def _design(base: Design, changes: Mapping[str, Any], name: str) -> Design:
    """The design with some numbers changed, and those of `UNCERTAIN` known by calibration only."""
    raw = _merged(base.model_dump(), changes)
    keys = [key for key in UNCERTAIN if key.split(".")[1] in raw[key.split(".")[0]]]
    provenance = {key: {"status": "chosen", "reason": "a variant for blind units"} for key in raw["provenance"]}
    unsure = {key: _unsure(raw, key) for key in keys}
    raw["provenance"] = {**provenance, **unsure}
    return parse_design(raw, name)


def _unsure(raw: Mapping[str, Any], key: str) -> dict[str, Any]:
    """Provenance of a number that is known within the factor by which the truth is drawn."""
    section, name = key.split(".")
    value, factor = raw[section][name], PLAUSIBLE
    reason = "stands for the number fitted to another unit"
    return {"status": "calibrated", "reason": reason, "plausible": (value / factor, value * factor)}


def _study(base: Study, design: Design, name: str, scale: float, reduce: Mapping[str, float]) -> dict[str, Any]:
    """Settings of a study of the design with tolerances of another size [`scale`]."""
    raw = base.model_dump(exclude={"name", "design", "cases"}, exclude_none=True)
    for tolerance in raw["tolerances"].values():
        for key in tolerance:
            if key.endswith("_um"):
                tolerance[key] *= scale
    raw["reduce"] = {**raw["reduce"], **reduce}
    rng = np.random.default_rng([17, design.cycloid.pins])
    slots = 360 / CRANKS_A_DESIGN
    cranks = [round(slots * (k + float(rng.uniform(0.1, 0.9))), 1) for k in range(CRANKS_A_DESIGN)]
    raw["cycle"] = {key: value for key, value in raw["cycle"].items() if key != "loaded_angles"} | {"crank_deg": cranks}
    raw["samples"] = {**raw["samples"], "nominal_first": False, "count": 10**6}
    return {**raw, "title": f"Blind units of {name}", "design": name}


def _generating(raw: Mapping[str, Any]) -> dict[str, Any]:
    """The study on a finer mesh with other patches and the other contact law."""
    coarse = raw["reduce"]
    finer = {
        "flank_edges_per_lobe": int(1.5 * coarse["flank_edges_per_lobe"]),
        "patch_half_width_mm": 0.8 * coarse["patch_half_width_mm"],
        "growth": 0.8 * coarse["growth"],
        "largest_edge_mm": 0.7 * coarse["largest_edge_mm"],
        "roller_patch_half_width_mm": 0.85 * coarse["roller_patch_half_width_mm"],
    }
    return {**raw, "reduce": finer, "springs": {**raw["springs"], "law": OTHER_LAW}}


def _parsed(raw: Mapping[str, Any], name: str, design: Design) -> Study:
    return parse_study(raw, name, name, lambda _: design)


@lru_cache(maxsize=4)
def catalogue(root: Path) -> tuple[CatalogueReducer, ...]:
    """The four reducers, derived from files of the project in `root`."""
    plate, holes = load_study("quick", root), load_study("pin_in_hole", root)
    wide = {"flank_edges_per_lobe": 48, "patch_half_width_mm": 0.25, "roller_patch_half_width_mm": 1.6}
    small = {"patch_half_width_mm": 0.35, "largest_edge_mm": 2.0, "roller_patch_half_width_mm": 0.5}
    entries: tuple[tuple[str, Study, Mapping[str, Any], float, Mapping[str, float]], ...] = (
        ("paper", plate, {}, 1.0, {}),
        ("plate_49", plate, PLATE_49, 1.3, wide),
        ("holes_39", holes, {}, 1.0, {}),
        ("holes_19", holes, HOLES_19, 0.7, small),
    )
    reducers = []
    for name, base, changes, scale, reduce in entries:
        design = _design(base.design, changes, name)
        raw = _study(base, design, name, scale, reduce)
        reducers.append(
            CatalogueReducer(
                name, _parsed(raw, f"{name}-model", design), _parsed(_generating(raw), f"{name}-truth", design)
            )
        )
    return tuple(reducers)


def condense(
    reducers: Sequence[CatalogueReducer], folder: Path, jobs: int
) -> dict[str, tuple[CataloguedCompliances, CataloguedCompliances]]:
    """Compliances of the model's and the generating study of each reducer; made once, kept in `folder` by content."""
    compliances = {}
    for reducer in reducers:
        outputs = [
            run(STAGES, study, ["reduce"], folder, Resources(jobs, 1))["reduce"]
            for study in (reducer.model, reducer.truth)
        ]
        model, truth = (CataloguedCompliances(output.path(COMPLIANCE_FILE)) for output in outputs)
        compliances[reducer.name] = (model, truth)
    return compliances
