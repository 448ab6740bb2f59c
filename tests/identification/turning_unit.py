"""Records of a turning drive for tests, of the second simulator of blind units, which shares no code with the model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.config.changing import toml_of
from pipeline.sampling.errors import draw
from tests.validation.blind.catalogue import catalogue
from tests.validation.blind.rigid_drive.effects import EFFECTS, NMM_PER_NM, RAD_PER_ARCMIN
from tests.validation.blind.rigid_unit import rigid_drive

ROOT = Path(__file__).parents[2]
(REDUCER,) = (design for design in catalogue(ROOT) if design.name == "holes_19")
GEAR = REDUCER.model.design.cycloid
INTERVALS = 10  # of a turn: two pitches of the 20 pins with four rows in each
SAMPLE, HELD = 7, 36.0
DIMENSIONS = ("pin_radial", "pin_tangential", "pin_radius", "lobe_profile", "disk_profile", "eccentricity")


@dataclass(frozen=True)
class Record:
    """How a drive is turned: per cycle each torque [N m] is held forward and backward over so many turns."""

    torques: tuple[float, ...] = (HELD, -HELD)
    senses: tuple[int, ...] = (1, -1)
    cycles: int = 2
    turns: int = 1
    per_pitch: int = 2
    noise: float = 0.02
    effects: Mapping[str, Sequence[float]] = field(default_factory=dict)
    friction: float = 0.0
    encoder: tuple[float, float] = (0.0, 0.0)
    outside: Callable[[np.ndarray], np.ndarray] = np.zeros_like
    settings: str = ""
    angle: str = "error"


def cranks(record: Record) -> np.ndarray:
    """Crank angles [deg] of a pass, the rows in the middle of equal steps."""
    count = GEAR.pins * record.per_pitch
    return (np.arange(count * record.turns) + 0.5) * 360 / count


@cache
def twist(crank_deg: float, torque: float, effects: tuple) -> float:
    """Angle [rad] of the output less the ideal one at a torque [N m] that the reducer carries."""
    drive = rigid_drive(REDUCER.rigid_truth.design, draw(REDUCER.rigid_truth, SAMPLE, SAMPLE + 1), crank_deg)
    for name, values in effects:
        drive = EFFECTS[name].drive(values)(drive, 0.0, 0.0)
    return float(drive.balanced(NMM_PER_NM * torque, np.zeros(5))[4] / drive.flank.circle_radius)


def table(record: Record) -> pd.DataFrame:
    """The rows of a record. Friction of the output resists its motion, which is against the sense of the crank."""
    rng = np.random.default_rng(1)
    effects = tuple((name, tuple(values)) for name, values in record.effects.items())
    parts = []
    for cycle in range(record.cycles):
        for torque in record.torques:
            for sense in record.senses:
                crank = cranks(record)[::sense]
                angle = np.array([twist(k, torque + sense * record.friction, effects) for k in crank])
                place = angle - np.radians(crank) / GEAR.lobes
                error = angle / RAD_PER_ARCMIN + record.outside(np.radians(crank))
                error += record.encoder[0] * np.cos(place) + record.encoder[1] * np.sin(place)
                error += 3.0 + record.noise * rng.standard_normal(len(crank))
                if record.angle == "absolute":
                    error -= 60 * crank / GEAR.lobes
                columns = {"cycle": cycle, "crank_deg": crank, "torque_Nm": torque, "angle_arcmin": error}
                parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


def write_record(folder: Path, record: Record, rows: pd.DataFrame | None = None) -> Path:
    """A unit's folder: the rows of a record, or others, with the design of the catalogue and its dimensions."""
    folder.mkdir(parents=True)
    (table(record) if rows is None else rows).to_csv(folder / "rows.csv", index=False)
    model = REDUCER.rigid_model
    settings = model.model_dump(mode="json", exclude={"name", "design", "cases"})
    (folder / "design.toml").write_text(toml_of(model.design.model_dump(mode="json")), encoding="utf-8")
    (folder / "study.toml").write_text(toml_of({**settings, "design": "design.toml"}), encoding="utf-8")
    sampled = draw(REDUCER.rigid_truth, SAMPLE, SAMPLE + 1)
    lines = [f"{name} = {np.round(getattr(sampled, name)[0], 3).tolist()}" for name in DIMENSIONS]
    (folder / "dims.toml").write_text("\n".join(lines), encoding="utf-8")
    (folder / "unit.toml").write_text(
        'title = "A turning drive"\ndesign = "design.toml"\nstudy = "study.toml"\nlocked = "neither"\n'
        f'offset = "common"\nas_measured = "dims.toml"\nangle = "{record.angle}"\n{record.settings}',
        encoding="utf-8",
    )
    return folder
