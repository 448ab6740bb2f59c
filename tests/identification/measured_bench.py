"""A bench for tests: units on disk, measured by a play with a linear spring and friction, and their files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

ROOT = Path(__file__).parents[2]
UNIT = """
title = "A unit of the tests"
design = "pham2017"
study = "quick"
locked = "input"
offset = "per_position"
as_measured = "unknown"
"""


def path_of(turns: list[float], per_branch: int) -> np.ndarray:
    """Torques [N m] along straight ramps from turn to turn, `per_branch` rows each after the first row."""
    steps = [np.linspace(a, b, per_branch + 1)[1:] for a, b in zip(turns[:-1], turns[1:], strict=True)]
    return np.concatenate([[turns[0]], *steps])


def loop(torque: np.ndarray, play: float = 1.0, rigidity: float = 5.0, friction: float = 0.5) -> np.ndarray:
    """Angle [arcmin] of a spring behind a play, with a Coulomb friction [N m] that follows the sense of the torque."""
    sense = np.sign(np.gradient(torque))
    net = torque - friction * sense
    return net / rigidity + play / 2 * np.tanh(20 * net / np.ptp(torque))


def measured(
    positions: tuple[float, ...] = (0.0, 90.0, 180.0),
    cycles: int = 3,
    per_branch: int = 80,
    noise: float = 0.02,
    seed: int = 1,
) -> pd.DataFrame:
    """Cycles 0 -> +12 -> -12 -> 0 N m at each position, with independent noise of the angle [arcmin]."""
    rng = np.random.default_rng(seed)
    parts = []
    for number, crank in enumerate(positions):
        for cycle in range(cycles):
            torque = path_of([0.0, 12.0, -12.0, 0.0], per_branch)
            angle = loop(torque) + 3.0 * number + noise * rng.standard_normal(torque.size)
            parts.append(pd.DataFrame({"cycle": cycle, "crank_deg": crank, "torque_Nm": torque, "angle_arcmin": angle}))
    return pd.concat(parts, ignore_index=True)


def write_unit(folder: Path, tables: dict[str, pd.DataFrame] | None = None, text: str = UNIT) -> Path:
    """A unit's folder with unit.toml and CSV files."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "unit.toml").write_text(text, encoding="utf-8")
    for name, table in (tables if tables is not None else {"rows.csv": measured()}).items():
        table.to_csv(folder / name, index=False)
    return folder
