"""A unit of the second simulator whose output is locked: its crank turns within the loops, and the motor is read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from measured_bench import ROOT, path_of

from pipeline.config import load_study
from pipeline.config.changing import toml_of
from pipeline.sampling.errors import draw
from tests.validation.blind.files import DIMENSIONS
from tests.validation.blind.rigid_drive.effects import EFFECTS
from tests.validation.blind.rigid_drive.train import LockedDrive, Train
from tests.validation.blind.rigid_unit import rigid_drive

CRANKS = (15.0, 480.0, 1290.0, 2475.0, 3630.0)
"""Crank angle [deg] at the first row of each position, over a turn of the output (4680)."""
TOP = 20.0  # [N m]
SMALLER_UM = 200.0
"""Of the disk's diameter: the run-outs leave clearance everywhere."""
FRICTION = 0.8  # [N m]
UNIT = """
title = "A drive of the second simulator whose output is locked"
design = "design.toml"
study = "study.toml"
as_measured = "dimensions.toml"
locked = "output"
offset = "per_position"
[crank]
moves = "{moves}"
ratio = -13.0
torque_at = "input"
"""


def write_locked_unit(
    folder: Path,
    effects: Mapping[str, Sequence[float]],
    *,
    noise: float = 0.02,
    cranks: Sequence[float] = CRANKS,
    per_branch: int = 60,
    reading: Sequence[float] = (0.0, 0.0),
    twist: float = 0.0,
    wave: tuple[float, float] = (0.0, 0.0),
    seed: int = 4,
) -> Path:
    """The printed drive with a rigid disk and known dimensions, at some crank angles [deg].

    Parameters
    ----------
    effects : of the second simulator, by name, with their values; the friction ``FRICTION`` is declared beside them.
    reading : amplitudes of an eccentric encoder [arcmin].
    twist : in series [rad/(N mm)], declared.
    wave : of it over a turn of the crank, cosine and sine [rad/(N mm)], not declared.
    """
    rng = np.random.default_rng(seed)
    study = load_study("printed_drive", ROOT)
    dimensions = replace(draw(study, 3, 4), disk_profile=np.array([SMALLER_UM]))
    changes = [changed for name, values in effects.items() if (changed := EFFECTS[name].drive)]

    def drive_at(crank: float):
        drive = rigid_drive(study.design, dimensions, float(np.degrees(crank)))
        for change, values in zip(changes, effects.values(), strict=True):
            drive = change(values)(drive, 0.0, 0.0)
        return drive

    locked = LockedDrive(drive_at, -13.0, twist, wave)
    torque = path_of([0.0, TOP, -TOP, TOP, -TOP, 0.0], per_branch)
    cycle = np.repeat([0, 1], [2 * per_branch + 1, 3 * per_branch])
    tables = []
    for crank in cranks:
        curve = locked.curve(np.radians(crank), 1.1e3 * TOP)
        angle, _ = Train(friction=1e3 * FRICTION).walked(curve, 1e3 * torque)
        turned = np.radians(crank) + 13.0 * (angle - angle[0])
        read = np.degrees(angle) * 60 + reading[0] * np.cos(turned) + reading[1] * np.sin(turned)
        columns = {"cycle": cycle, "crank_deg": crank, "torque_Nm": torque}
        columns["angle_arcmin"] = read + rng.normal(0, 5) + noise * rng.standard_normal(len(torque))
        tables.append(pd.DataFrame(columns))
    folder.mkdir(parents=True)
    pd.concat(tables).to_csv(folder / "rows.csv", index=False)
    _write_study(folder, study, twist)
    lines = {name: np.round(getattr(dimensions, name)[0], 3).tolist() for name in DIMENSIONS}
    (folder / "dimensions.toml").write_text(toml_of(lines), encoding="utf-8")
    (folder / "unit.toml").write_text(UNIT.format(moves="follows_angle"), encoding="utf-8")
    return folder


def _write_study(folder: Path, study, twist: float) -> None:
    """Design and study of a rigid disk; friction and twist are declared as effects."""
    design = study.design.model_dump(mode="json", exclude_defaults=True)
    effects = {"coulomb": {"torque_Nm": FRICTION}}
    if twist:
        effects["output_torsion"] = {"compliance_arcmin_per_Nm": float(np.degrees(twist) * 60 * 1e3)}
    given = {
        f"effects.{name}.{key}": {"status": "given", "reason": "of this unit"}
        for name in effects
        for key in effects[name]
    }
    chosen = {key: {"status": "chosen", "reason": "of this unit"} for key in design["provenance"]}
    content = {**design, "effects": effects, "provenance": {**chosen, **given}}
    (folder / "design.toml").write_text(toml_of(content), encoding="utf-8")
    settings = study.model_dump(mode="json", exclude={"name", "design", "cases"}, exclude_defaults=True)
    settings["clearance"] = {**settings["clearance"], "disk_reading": "radial_on_diameter"}
    settings["springs"] = {**settings.get("springs", {}), "law": "palmgren"}
    settings["reduce"] = {**settings["reduce"], "disk": "rigid"}
    (folder / "study.toml").write_text(toml_of({**settings, "design": "design.toml"}), encoding="utf-8")
