"""Running CalculiX on a deck and reading what it prints."""

import os
import shutil
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.checks.calculix.deck import SPAN, Deck
from pipeline.model.geometry.cycloid_profile import Real

PROGRAM = "ccx"
INSTALL = "apt install calculix-ccx"
THREADS = 2
"""Of the solver of equations: the cores of the machine that the project is made for."""
KIB = 1024
"""Unit of the memory that the operating system counts [byte]."""


@dataclass(frozen=True)
class Answer:
    """What CalculiX computed.

    Attributes
    ----------
    angle : (n_torques,) rotation of the output from the nominal pose [rad].
    force : (n_torques, n_contacts) [N]
    seconds, peak_bytes : of the program.
    iterations : of all steps together.
    """

    angle: Real
    force: Real
    seconds: float
    peak_bytes: int
    iterations: int


def calculix_program() -> str | None:
    """Path of CalculiX; None where it is not installed."""
    return shutil.which(PROGRAM)


def run_calculix(deck: Deck, folder: Path) -> Answer:
    """Solve the deck in a folder, which keeps the program's files.

    Raises
    ------
    RuntimeError
        If the program fails or does not finish every load step, with the end of what it said.
    """
    program = calculix_program()
    if program is None:
        raise RuntimeError(f"{PROGRAM} is not installed; {INSTALL}")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "reducer.inp").write_text(deck.text)
    start = time.perf_counter()
    with (folder / "reducer.log").open("w") as log:
        process = subprocess.Popen(
            [program, "reducer"],
            cwd=folder,
            stdout=log,
            stderr=subprocess.STDOUT,
            env=os.environ | {"OMP_NUM_THREADS": str(THREADS)},
        )
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    seconds = time.perf_counter() - start
    output = (folder / "reducer.log").read_text(errors="replace")
    angle, force = _printed(deck, folder / "reducer.dat")
    if process.returncode != 0 or len(angle) != len(deck.torque):
        raise RuntimeError(f"{PROGRAM} solved {len(angle)} of {len(deck.torque)} load steps: {output[-500:]}")
    return Answer(angle, force, seconds, usage.ru_maxrss * KIB, output.count("\n iteration "))


def _printed(deck: Deck, path: Path) -> tuple[Real, Real]:
    """Rotations (n_steps,) and contact forces (n_steps, n_contacts) of the blocks that the program printed."""
    blocks: dict[str, list[dict[int, float]]] = {"forces": [], "displacements": []}
    for line in path.read_text().splitlines() if path.exists() else []:
        words = line.split()
        if words and words[0] in blocks:
            values: dict[int, float] = {}
            blocks[words[0]].append(values)
        elif words:
            values[int(words[0])] = float(words[1])
    angle = [deck.first_angle + values[deck.output_node] / SPAN for values in blocks["displacements"]]
    force = [[abs(values[node]) for node in deck.springs] for values in blocks["forces"]]
    return np.array(angle), np.array(force)
