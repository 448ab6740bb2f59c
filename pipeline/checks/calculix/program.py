"""Running CalculiX on a deck and reading what it prints; the deck as a file, for an engineer to check us with."""

import os
import shutil
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.arrays import Real
from pipeline.checks.calculix.deck import SPAN, Deck, calculix_deck
from pipeline.checks.specimen import SHARES, Specimen, loaded_equilibria
from pipeline.config import Study
from pipeline.engine.store import write_atomic
from pipeline.model.load_history.load_cycle import ARCMIN
from pipeline.model.units import NMM_PER_NM

PROGRAM = "ccx"
NAME = "reducer"
"""Of the files of a whole reducer."""
INSTALL = "apt install calculix-ccx"
THREADS = 2
"""Of the solver of equations: the cores of the machine that the project is made for."""
KIB = 1024
"""Unit of the memory that the operating system counts [byte]."""


@dataclass(frozen=True)
class ProgramResult:
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


@dataclass(frozen=True)
class ProgramRun:
    """What a run of the program took, and what it said.

    Attributes
    ----------
    seconds, peak_bytes : of the program.
    output : all that it wrote to the terminal.
    """

    seconds: float
    peak_bytes: int
    output: str


def run_calculix(deck: Deck, folder: Path) -> ProgramResult:
    """Solve the deck in a folder, which keeps the program's files.

    Raises
    ------
    RuntimeError
        If the program fails or does not finish every load step, with the end of what it said.
    """
    ran = execute(deck.text, len(deck.torque), NAME, folder)
    blocks = printed_blocks(folder / f"{NAME}.dat")
    angle = [deck.first_angle + values[deck.output_node][0] / SPAN for values in blocks["displacements"]]
    force = [[abs(values[node][0]) for node in deck.springs] for values in blocks["forces"]]
    iterations = ran.output.count("\n iteration ")
    return ProgramResult(np.array(angle), np.array(force), ran.seconds, ran.peak_bytes, iterations)


def execute(text: str, steps: int, name: str, folder: Path) -> ProgramRun:
    """Run the program on a deck of so many load steps; its files keep the name in the folder.

    Raises
    ------
    RuntimeError
        If the program fails or does not print every load step, with the end of what it said.
    """
    program = calculix_program()
    if program is None:
        raise RuntimeError(f"{PROGRAM} is not installed; {INSTALL}")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.inp").write_text(text)
    variables = os.environ | {"OMP_NUM_THREADS": str(THREADS)}
    start = time.perf_counter()
    with (folder / f"{name}.log").open("w") as log:
        process = subprocess.Popen([program, name], cwd=folder, stdout=log, stderr=subprocess.STDOUT, env=variables)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    seconds = time.perf_counter() - start
    output = (folder / f"{name}.log").read_text(errors="replace")
    increments = len(printed_blocks(folder / f"{name}.dat")["displacements"])
    if process.returncode != 0 or increments != steps:
        raise RuntimeError(f"{PROGRAM} solved {increments} of {steps} load steps: {output[-500:]}")
    return ProgramRun(seconds, usage.ru_maxrss * KIB, output)


def printed_blocks(path: Path) -> dict[str, list[dict[int, tuple[float, ...]]]]:
    """Forces and displacements that the program printed: for every load step the components at every node."""
    blocks: dict[str, list[dict[int, tuple[float, ...]]]] = {"forces": [], "displacements": []}
    for line in path.read_text().splitlines() if path.exists() else []:
        words = line.split()
        if words and words[0] in blocks:
            values: dict[int, tuple[float, ...]] = {}
            blocks[words[0]].append(values)
        elif words:
            values[int(words[0])] = tuple(map(float, words[1:]))
    return blocks


def export(study: Study, sample: int, crank_deg: float, folder: Path) -> str:
    """Write the deck of a sample at five output torques, and say where it is and what the study's model answers.

    Raises
    ------
    InputError
        If CalculiX has no spring for the bearing.
    """
    specimen = Specimen(study, sample, crank_deg)
    torque = SHARES * specimen.rated_torque
    states = loaded_equilibria(specimen, torque)
    deck = calculix_deck(specimen, torque, states)
    name = f"sample-{sample}-crank-{crank_deg:g}"
    write_atomic(folder / f"{name}.inp", deck.text.encode())
    rows = [
        f"  {load / NMM_PER_NM:8.4g} N m   {ARCMIN * angle:10.5f} arcmin   {force.max():9.3f} N"
        for load, angle, force in zip(
            torque, states.motion[0, :, specimen.reducer.output_motion], states.force[0], strict=True
        )
    ]
    return "\n".join(
        [
            f"deck: {folder / name}.inp; run it with: {PROGRAM} {name}",
            f"output angle = {ARCMIN * deck.first_angle:.5f} arcmin + {ARCMIN / SPAN:.6g} arcmin/mm times "
            f"displacement 1 of node {deck.output_node};",
            f"contact force i = reaction of node {deck.springs[0]} + i",
            "the study's model: torque, output angle, largest contact force",
            *rows,
        ]
    )
