"""Units of one rig, each state of a drive with several lock positions, predicted from what was not predicted yet.

The files are those of ``data/measured/base_pccf_runin/SOURCE.md`` as their author wrote them: a folder a state, a file
``position<n>.csv.gz`` a lock position. Each state becomes a unit of a drive without a design: every twelfth row of the
ramps to +-40 N m, lock position 1 fitted, the others held out.

The output is locked and POSITION is the motor's encoder over the ratio, so that the crank turns through 72 to 233
degrees within a loop. The encoder is absolute within a turn of the motor: POSITION times the ratio, modulo one, is the
crank angle up to a constant of the assembly. It was verified by the positions themselves: they lie 1/8 turn of the
output apart, that is 0.0288 = 2/13 - 1/8 turns modulo 1/13 (0.027 to 0.033 in ``conic_june``), and position 9 is
position 1 again. The whole turns of the crank follow from the number of the position.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arrays import Real, Truth
from pipeline.config.files.section import nearest_name
from pipeline.errors import InputError
from pipeline.identification.fitting.cells_in_noise import data_of
from pipeline.identification.fitting.measured_loops import crank_loops
from pipeline.identification.generic.crank_loops import CrankLoops
from pipeline.identification.generic.shared_fit import fitted_together
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.selection.baselines import Cycles, baselines
from pipeline.identification.series.folds import held_numbers, mean_squares, predicted_by_others, reversed_numbers

EVERY, FIRST_RAMP = 12, 100
"""Row that is kept, and first of the ramps to +-40 N m: as ``thinned.py`` of the project's own unit has them."""
RATIO = 13
"""Turns of the crank per turn of the output."""
ARCMIN_A_TURN = 21600.0
"""Minutes of arc in a turn."""
HOLES = 8
"""Lock positions in a turn of the output."""
TRAINED, AGAIN = "position1", "position1_again"
"""Lock position that is fitted, and the same locked again."""
SOFT_TERMS = ("friction_spread", "first_loading")
"""Of each state by itself: one position does not tell an asymmetry from an error of the angle."""
SHARED_TERMS = (*SOFT_TERMS, "asymmetry")
"""Whose numbers come from the other states of a series."""
EFFECT = "pin_circle_runout"
"""Effect of the crank angle whose numbers come from the other states: first of its class."""
EFFECT_TERMS = (*SHARED_TERMS, EFFECT)
TITLES = {
    "replay of the training loops": "replay",
    "polynomial for each branch": "polynomial",
    "play, spring, Coulomb and load friction": "play_friction",
}
"""Columns of the baselines."""
UNIT = """\
title = "Printed drive, {state}"
locked = "output"
offset = "per_position"

[generic]
ratio = 13.0
rated_torque_Nm = 40.0

[crank]
moves = "follows_angle"
ratio = -13.0
torque_at = "input"

[state]
assembly = "{series}"
{turns}

[instrument]
angle_resolution_arcmin = 0.33

[held_out]
by = "position"
train = [{trained}]
"""
FILE = """
[[files]]
path = "{name}.csv"
position = "{number}"
crank_deg = {crank}
"""


def states_of(sources: Sequence[Path]) -> list[Path]:
    """Folders of states below some folders.

    Raises
    ------
    InputError : there is none.
    """
    states = sorted(
        {file.parent for source in sources for file in source.glob(f"**/{TRAINED}.csv.gz")}, key=lambda path: path.name
    )
    if not states:
        names = ", ".join(str(source) for source in sources)
        raise InputError(f"{names}: no folder with a file {TRAINED}.csv.gz; name the folder of the rig's data")
    return states


def series_name(state: str) -> str:
    """The drive of a state: its name less what was done to it."""
    return state.rpartition("_")[0]


def relocked_position(state: Path) -> str:
    """Name of the file in which a state's first position was locked again; empty if none was."""
    names = (AGAIN, f"position{HOLES + 1}")
    return next((name for name in names if (state / f"{name}.csv.gz").is_file()), "")


def write_unit(state: Path, folder: Path, files: Sequence[str] = ()) -> Path:
    """Write the unit of a state into ``folder``; returns it. ``files``: names of positions, those of the state if none.

    Raises
    ------
    InputError : a file is missing.
    """
    names = list(files) or sorted(path.name.split(".")[0] for path in state.glob("position?.csv.gz"))
    parts = {name: thinned(state / f"{name}.csv.gz") for name in names}
    folder.mkdir(parents=True, exist_ok=True)
    turns = preload_turns(state.name)
    text = UNIT.format(
        state=state.name,
        series=series_name(state.name),
        turns="" if turns is None else f"values = {{ preload_turns = {turns} }}",
        trained=parts[TRAINED][1],
    )
    for name, (rows, crank) in parts.items():
        rows.to_csv(folder / f"{name}.csv", index=False)
        text += FILE.format(name=name, number=name.removeprefix("position"), crank=crank)
    (folder / "unit.toml").write_text(text, encoding="utf-8")
    return folder


def preload_turns(state: str) -> int | None:
    """Turns of the preload screw or spring, by the name of a state; None where it is another change."""
    change = state.rpartition("_")[2]
    found = re.fullmatch(r"(\d+)pre|preload(\d+)", change)
    return 0 if change == "runin" else int(found[1] or found[2]) if found else None


def thinned(path: Path) -> tuple[pd.DataFrame, float]:
    """Rows of one lock position in the columns of a measured unit, and the crank angle of the first [deg].

    Raises
    ------
    InputError : there is no such file.
    """
    if not path.is_file():
        raise InputError(
            f"{path.name}: no such file; {nearest_name(path.name, [p.name for p in path.parent.glob('*')])}"
        )
    raw = pd.read_csv(path)
    rows = raw[raw["test_nr"] >= FIRST_RAMP].iloc[::EVERY]
    crank = crank_angle(int(path.name.removeprefix("position")[0]), float(rows["POSITION"].iloc[0]))
    table = pd.DataFrame(
        {
            "cycle": rows["test_nr"] - FIRST_RAMP,
            "torque_Nm": rows["TORQUE"].round(4),
            "angle_arcmin": (ARCMIN_A_TURN * rows["POSITION"]).round(3),
            "time_s": rows["TIME"].round(3),
            "command_torque_Nm": rows["CONTROL_TORQUE"].round(3),
        }
    )
    return table, crank


def crank_angle(number: int, position: float) -> float:
    """Crank angle [deg] over a turn of the output, of a lock position by its number and POSITION [turns].

    Position n has the output at (n - 1)/8 turn, and so the crank at -(n - 1)/8 of 13 turns; POSITION keeps what is left
    of a turn of the crank.
    """
    turns = round((-(number - 1) / HOLES - position) * RATIO)
    return round(360 * (RATIO * position + turns) % (360 * RATIO), 3)


def predicted_states(measurements: Mapping[str, Measurement], again: Mapping[str, Measurement]) -> pd.DataFrame:
    """Errors [arcmin] at positions that nothing was fitted to, a row a state, and their medians in the last row.

    Columns: ``before`` (play, spring, friction), ``refitted`` (friction in stages and first loading beside), each of
    position 1 alone; ``effect`` and ``reversed`` with what the other states of the series say of the material and of
    the crank's angle, and with the sign of the latter turned round as a control; the baselines of position 1; ``floor``
    where position 1 was locked again: what its loops predict of themselves. ``left_out`` to ``left_out_replay`` predict
    each position from all others of the state: refitted, with the material of the other states of the series, with
    their material and effect (its own effect where there is no other state), and by replay.
    """
    loops = {name: crank_loops(measurement) for name, measurement in measurements.items()}
    rows = []
    for name, measurement in measurements.items():
        state, trained = loops[name], measurement.training_cells
        before = fitted_together([state.some(trained)])
        refitted = fitted_together([state.some(trained)], SOFT_TERMS)
        curves = {"before": before.predicted_angles[0], "refitted": refitted.predicted_angles[0]}
        others = [loops[other] for other in loops if _beside(name, other)]
        held = shared_numbers(others, EFFECT_TERMS)
        curves |= with_effect(state.some(trained), held)
        curves |= replays(measurement, trained)
        errors = {key: rms(state, curve, ~trained) for key, curve in curves.items()}
        floor = again.get(name)
        if floor is not None:
            first = floor.training_cells
            errors["floor"] = rms(crank_loops(floor), replays(floor, first)["replay"], ~first)
        errors |= left_out(measurement, state, held, shared_numbers(others, SHARED_TERMS))
        rows.append({"state": name, **errors})
    frame = pd.DataFrame(rows)
    return pd.concat([frame, pd.DataFrame([{"state": "median", **frame.median(numeric_only=True)}])], ignore_index=True)


def shared_numbers(others: Sequence[CrankLoops], terms: Sequence[str]) -> dict[str, float]:
    """Numbers of some terms that other states of a series share; none without any."""
    return held_numbers(fitted_together(others, terms)) if others else {}


def with_effect(state: CrankLoops, held: Mapping[str, float]) -> dict[str, Real]:
    """Predictions (n_cells,) with the shared numbers of other states, and with their effect reversed; none without."""
    numbers = {"effect": held, "reversed": reversed_numbers(held, EFFECT)} if held else {}
    return {title: predicted_by_others(state, EFFECT_TERMS, values) for title, values in numbers.items()}


def left_out(
    measurement: Measurement, state: CrankLoops, held: Mapping[str, float], material: Mapping[str, float]
) -> dict[str, float]:
    """Errors [arcmin] of each position predicted from all others of its state, and from what other states say.

    ``held`` are their numbers of the material and of the effect fitted together, ``material`` without an effect.
    """
    models: dict[str, tuple[Sequence[str], Mapping[str, float]]] = {"left_out": (SOFT_TERMS, {})}
    models |= {"left_out_material": (SHARED_TERMS, material)} if material else {}
    models["left_out_effect"] = (EFFECT_TERMS if held else (*SOFT_TERMS, EFFECT), held)
    curves = {name: np.full(len(state.angle), np.nan) for name in (*models, "left_out_replay")}
    for position in np.unique(state.position):
        cells = state.position == position
        for name, (terms, numbers) in models.items():
            fit = fitted_together([state.some(~cells)], terms, held=numbers)
            curves[name][cells] = fit.predicted_angles[0][cells]
        curves["left_out_replay"][cells] = replays(measurement, ~cells)["replay"][cells]
    return {name: rms(state, curve, np.ones(len(curve), bool)) for name, curve in curves.items()}


def replays(measurement: Measurement, trained: Truth) -> dict[str, Real]:
    """Predictions (n_cells,) of the baselines fitted to some cells; NaN at these."""
    data = data_of(measurement, trained)
    cycles = Cycles(measurement.cells.direction, measurement.branches.kind[measurement.cells.block])
    curves = baselines(data, cycles, [(trained, ~trained)], data.offsets)
    return {TITLES[title]: curve for title, curve in curves.items()}


def rms(state: CrankLoops, curve: Real, cells: Truth) -> float:
    """Root mean square error [arcmin] over some cells."""
    return float(np.sqrt(mean_squares(state, curve, cells)))


def _beside(state: str, other: str) -> bool:
    """Whether two are different states of one series."""
    return state != other and series_name(state) == series_name(other)
