"""Units of one rig, each state of a drive with several lock positions, identified and held against the baselines.

The files are those of ``data/measured/base_pccf_runin/SOURCE.md`` as their author wrote them: a folder a state, a file
``position<n>.csv.gz`` a lock position. Each state becomes a unit as that one is: every twelfth row of the ramps to +-40
N m, lock position 1 fitted, the others held out.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from pipeline.errors import InputError

EVERY, FIRST_RAMP = 12, 100
"""Row that is kept, and first of the ramps to +-40 N m: as ``thinned.py`` of the project's own unit has them."""
RATIO = 13
"""Turns of the crank per turn of the output."""
ARCMIN_A_TURN = 21600.0
"""Minutes of arc in a turn."""
TRAINED = "position1"
"""Lock position that is fitted."""
UNIT = """\
title = "Printed drive, {state}"
design = "printed_drive"
study = "printed_drive"
locked = "output"
offset = "per_position"
crank_angles = "unknown"
as_measured = "unknown"

[instrument]
angle_resolution_arcmin = 0.33

[held_out]
by = "position"
train = [{crank}]
"""


def states_of(sources: Sequence[Path]) -> list[Path]:
    """Folders of states below some folders.

    Raises
    ------
    InputError : there is none.
    """
    states = sorted({file.parent for source in sources for file in source.glob(f"**/{TRAINED}.csv.gz")})
    if not states:
        names = ", ".join(str(source) for source in sources)
        raise InputError(f"{names}: no folder with a file {TRAINED}.csv.gz; name the folder of the rig's data")
    return states


def write_unit(state: Path, folder: Path) -> Path:
    """Write the unit of a state into ``folder``; returns it."""
    parts: dict[str, pd.DataFrame] = {}
    cranks: list[float] = []
    for path in sorted(state.glob("position?.csv.gz")):
        rows, crank = thinned(path, cranks)
        cranks.append(crank)
        parts[path.name.split(".")[0]] = rows.assign(crank_deg=crank)
    folder.mkdir(parents=True, exist_ok=True)
    pd.concat(parts.values()).to_csv(folder / "rows.csv", index=False)
    trained = parts[TRAINED]["crank_deg"].iloc[0]
    (folder / "unit.toml").write_text(UNIT.format(state=state.name, crank=trained), encoding="utf-8")
    return folder


def thinned(path: Path, crank_angles: Sequence[float]) -> tuple[pd.DataFrame, float]:
    """Rows of one lock position in the columns of a measured unit, and its crank angle [deg], none of ``crank_angles``.

    No angle is published. The one given tells the positions apart: the middle of POSITION times the ratio, as if the
    encoder kept its zero between them.
    """
    raw = pd.read_csv(path)
    rows = raw[raw["test_nr"] >= FIRST_RAMP].iloc[::EVERY]
    crank = float(round(180 * RATIO * (rows["POSITION"].min() + rows["POSITION"].max())) % 360)
    while crank in crank_angles:
        crank += 1
    columns = {
        "cycle": rows["test_nr"] - FIRST_RAMP,
        "torque_Nm": rows["TORQUE"].round(4),
        "angle_arcmin": (ARCMIN_A_TURN * rows["POSITION"]).round(3),
        "time_s": rows["TIME"].round(3),
        "command_torque_Nm": rows["CONTROL_TORQUE"].round(3),
    }
    return pd.DataFrame(columns), crank


def table(folders: Sequence[Path]) -> pd.DataFrame:
    """Held-out rms [arcmin] of each unit by the file ``verdict.json`` of its folder, and the medians in the last row.

    Columns: unit, verdict, what is claimed, the best description (claimed or not), the same with what of its training
    residual is expected to come again (the description alone where nothing is left), and the three baselines.
    """
    rows = []
    for folder in folders:
        verdict = json.loads((folder / "verdict.json").read_text(encoding="utf-8"))
        best = verdict["described"] or verdict["held_out_errors"]["after"]
        errors = {"described": best, "carried": verdict["carried"] or best} | verdict["baselines"]
        words = {"unit": folder.name, "verdict": verdict["verdict"], "claimed": "+".join(verdict["named"])}
        rows.append(words | {title: round(error["rms_arcmin"], 1) for title, error in errors.items()})
    frame = pd.DataFrame(rows)
    medians = frame.median(numeric_only=True).round(1)
    return pd.concat([frame, pd.DataFrame([{"unit": "median", **medians}])], ignore_index=True)
