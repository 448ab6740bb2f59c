"""The command that writes the flank of a design, as drawn and as measured."""

import argparse
from dataclasses import replace

import numpy as np
import pandas as pd

from pipeline import assembly, settings
from pipeline.config import load_design
from pipeline.engine.store import write_atomic
from pipeline.errors import InputError
from pipeline.figures.mesh import outlines_dxf
from pipeline.model.geometry.cycloid_profile import CycloidProfile
from pipeline.model.geometry.drawn_flank import drawn_flank

SMALLEST_COUNT, LARGEST_COUNT = 8, 100_000
"""Points of a lobe."""


def write_flank(options: argparse.Namespace) -> None:
    """Write ``drawn.csv``, ``measured.csv`` where a deviation was measured, and ``flank.dxf`` with a layer of each."""
    if not SMALLEST_COUNT <= options.points <= LARGEST_COUNT:
        raise InputError(f"--points = {options.points}; must be {SMALLEST_COUNT} to {LARGEST_COUNT} of a lobe")
    profile = assembly.profile(load_design(options.design, settings.ROOT))
    drawn_profile = replace(profile, modification=replace(profile.modification, measured_flank=None))
    tables = {"drawn": flank_points(drawn_profile, options.points)}
    if profile.modification.measured_flank is not None:
        tables["measured"] = flank_points(profile, options.points)
    for name, table in tables.items():
        write_atomic(options.out / f"{name}.csv", table.to_csv(index=False, float_format="%.9f").encode())
    outlines = {name: (table["x_mm"] + 1j * table["y_mm"]).to_numpy() for name, table in tables.items()}
    write_atomic(options.out / "flank.dxf", outlines_dxf(outlines))
    for name in (*(f"{name}.csv" for name in tables), "flank.dxf"):
        print(settings.shown(options.out / name))


def flank_points(profile: CycloidProfile, points: int) -> pd.DataFrame:
    """So many points of each lobe in the disk's frame, clockwise from the root at angle 0, equally far in phase."""
    lobe = np.repeat(np.arange(profile.lobes), points)
    phase = np.tile(2 * np.pi * np.arange(points) / points, profile.lobes)
    flank = drawn_flank(profile, lobe, phase)
    inward = profile.generating.normal(-(lobe + phase / (2 * np.pi)) * profile.lobe_pitch)
    return pd.DataFrame(
        {
            "lobe": lobe,
            "phase_deg": np.degrees(phase),
            "x_mm": flank.real,
            "y_mm": flank.imag,
            "normal_x": -inward.real,
            "normal_y": -inward.imag,
        }
    )
