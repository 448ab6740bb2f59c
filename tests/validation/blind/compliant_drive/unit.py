"""A unit of the third simulator: drawn by seed, written as a bench leaves it, its truth handed out apart."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.signal import lfilter

from pipeline.arrays import Real
from tests.validation.blind.compliant_drive.causes import (
    FIXED_VALUES,
    LIBRARY,
    Course,
    DrawnLaw,
    Position,
    drawn_law,
    work_taken,
)
from tests.validation.blind.compliant_drive.drawing import Parts, drawn_parts, written_files
from tests.validation.blind.compliant_drive.statics import UnbalancedError

KINDS = ("none", "one", "two", "outside")
SHARES = 200, 200, 60, 100
"""Units of each kind in the full run."""
SIZES = 1.0, 30.0
"""Least and largest size of what is put in, in the noise of a cell."""
BINS = 16
"""Torques of each branch over which a size is averaged."""
TRIES = 40
"""Draws of what is put in until one reaches its size."""
LARGEST_SHARE, NO_WORK = 0.5, 1e-3
"""Largest amplitude of a law in the range of the angle; share of a loop's box that counts as no work."""
ROWS = 1600
"""Rows of a position."""


@dataclass(frozen=True)
class Bench:
    """How a unit is measured; ``noise`` of a row's angle [arcmin], ``kept`` of it from row to row, steps of reading."""

    courses: tuple[Course, ...]
    cranks: tuple[float, ...]
    common_zero: bool
    noise: float
    kept: float
    angle_step: float
    torque_noise: float
    warmed: bool


def kind_of(case: int) -> str:
    """Kind of a case: any first cases have the proportions of the full run as nearly as can be."""
    counts, kind = np.zeros(len(KINDS)), 0
    for number in range(case + 1):
        kind = int(np.argmax(np.array(SHARES) * (number + 1) / sum(SHARES) - counts))
        counts[kind] += 1
    return KINDS[kind]


def _courses(rng: np.random.Generator, rated: float, cranks: Sequence[float]) -> tuple[bool, tuple[Course, ...]]:
    top, cycles = rated * float(rng.uniform(0.7, 1.0)), int(rng.integers(2, 5))
    first, inner = float(rng.choice([-1.0, 1.0])), float(rng.uniform(-0.3, 0.5))
    has_inner, warmed = bool(rng.random() < 0.4), bool(rng.random() < 0.35)
    turns, numbers = [0.0], [0]
    for cycle in range(cycles):
        legs = [first, *([first * inner, first] if has_inner else []), -first]
        turns += [top * leg for leg in legs]
        numbers += [cycle] * len(legs)
    travel = np.abs(np.diff(turns))
    rows = np.maximum((ROWS * travel / travel.sum()).astype(int), 8)
    period, begin, courses = float(rng.uniform(40, 160)), 0.0, []
    speed = rng.uniform(0.4, 2.5, cycles) if rng.random() < 0.5 else np.ones(cycles)
    for _ in cranks:
        torque, time, cycle_rows, clock = [], [], [], begin
        for leg, count in enumerate(rows):
            phase = (np.arange(count) + 0.5) / count
            ramp = 0.5 - 0.5 * np.cos(np.pi * phase)
            lasts = period * travel[leg] / (4 * top) / speed[numbers[leg + 1]]
            torque.append(turns[leg] + ramp * (turns[leg + 1] - turns[leg]))
            time.append(clock + lasts * phase)
            cycle_rows.append(np.full(count, numbers[leg + 1]))
            clock += lasts
        warm = rng.uniform(-5, 25, cycles) if warmed else np.zeros(cycles)
        courses.append(Course(np.concatenate(torque), np.concatenate(time), np.concatenate(cycle_rows), warm))
        begin = clock + float(rng.uniform(60, 400))
    return warmed, tuple(courses)


class Unit:
    """One case of a seed.

    Raises
    ------
    UnbalancedError : its drive, or what is put in, has no equilibrium.
    """

    def __init__(self, seed: int, case: int, attempt: int, designs: Mapping[str, Any], elastic: bool | None = None):
        streams = np.random.SeedSequence([seed, case, attempt]).spawn(4)
        of_parts, of_bench, of_cause, self._of_noise = streams
        self.kind, self.case, self.seed = kind_of(case), case, seed
        self.parts: Parts = drawn_parts(np.random.default_rng(of_parts), designs, elastic)
        rng = np.random.default_rng(of_bench)
        count = int(rng.choice([2, 3, 4, 6], p=[0.15, 0.55, 0.2, 0.1]))
        cranks = tuple(
            sorted(round(float(crank), 1) for crank in 360 * (np.arange(count) + rng.uniform(0.1, 0.9, count)) / count)
        )
        warmed, courses = _courses(rng, self.parts.rated, cranks)
        self.positions = tuple(
            Position(self.parts.disk(crank), course) for crank, course in zip(cranks, courses, strict=True)
        )
        self.plain = [position.angle() for position in self.positions]
        kept = float(rng.choice([0.0, rng.uniform(0.3, 0.9)]))
        cell = max(position.span for position in self.positions) * float(10 ** rng.uniform(-2.5, -1.7))
        in_cell = ROWS / (np.sum(np.abs(np.diff(courses[0].torque))) / courses[0].top * BINS)
        noise = cell * np.sqrt(max(in_cell, 3.0) * (1 - kept) / (1 + kept))
        self.cell_noise = cell
        step = float(rng.uniform(0.2, 1.0)) * noise
        common_zero, torque_noise = bool(rng.random() < 0.5), 1e-3 * courses[0].top
        self.bench = Bench(courses, cranks, common_zero, float(noise), kept, step, torque_noise, warmed=warmed)
        self.truth, self.angles = self._with_cause(np.random.default_rng(of_cause))

    def _testable(self, name: str) -> bool:
        needs = LIBRARY[name].needs
        if needs == "temperature":
            return self.bench.warmed
        if needs == "crank":
            return len(self.positions) >= 3
        if needs == "zero":
            return self.bench.common_zero
        return needs != "rate" or len(np.unique(np.round(np.diff(self.bench.courses[0].time), 6))) > 3

    def cells(self, change: Sequence[Real]) -> Real:
        """A change of the angle (n_rows,) per position as means of cells in noise, zeros of the angle taken out."""
        means = []
        for position, part in zip(self.positions, change, strict=True):
            course = position.course
            rising = np.gradient(course.torque) > 0
            level = np.clip(((course.torque / course.top + 1) * BINS / 2).astype(int), 0, BINS - 1)
            cell = np.ravel_multi_index((course.cycle, rising.astype(int), level), (course.cycle.max() + 1, 2, BINS))
            counts = np.bincount(cell)
            mean = np.bincount(cell, part)[counts > 0] / counts[counts > 0]
            means.append(mean if self.bench.common_zero else mean - mean.mean())
        joined = np.concatenate(means)
        return np.asarray((joined - joined.mean()) / self.cell_noise)

    def size(self, angles: Sequence[Real]) -> float:
        """Root mean square [noise of a cell] of a change of the angle that no stretch of the curve follows."""
        cells = self.cells([angle - plain for angle, plain in zip(angles, self.plain, strict=True)])
        stretch = self.cells(self.plain)
        left = cells - stretch * (stretch @ cells) / (stretch @ stretch)
        return float(np.sqrt(np.mean(left**2)))

    def _angles(self, name: str, values: Sequence[float]) -> list[Real]:
        return [position.angle(name, values) for position in self.positions]

    def _with_cause(self, rng: np.random.Generator) -> tuple[dict[str, Any], list[Real]]:
        none = {"truth": "none", "size": 0.0, "causes": []}
        if self.kind == "none":
            return none, self.plain
        for _ in range(TRIES):
            try:
                made = self._outside(rng) if self.kind == "outside" else self._library(rng)
            except UnbalancedError:
                continue
            if made:
                return made
        raise UnbalancedError("nothing reaches its size")

    def _sized(self, rng: np.random.Generator, angles_at: Any) -> tuple[float, list[Real], float] | None:
        """Share of the largest amplitude that has a drawn size, its angles and the size."""
        target, share = float(np.exp(rng.uniform(*np.log(SIZES)))), 0.3
        for _ in range(6):
            angles = angles_at(share)
            size = self.size(angles)
            if abs(np.log(max(size, 1e-9) / target)) < 0.1:
                return share, angles, size
            share = float(np.clip(share * np.clip(target / max(size, 1e-9), 0.05, 20.0), 1e-4, 1.0))
        return (share, angles, size) if SIZES[0] <= size <= SIZES[1] else None

    def _library(self, rng: np.random.Generator) -> tuple[dict[str, Any], list[Real]] | None:
        names = [name for name in LIBRARY if self._testable(name)]
        first, second = rng.choice(names, 2, replace=False).tolist()
        if self.kind == "two":
            first, second = _one_of_the_drive(first, second)
            if not second:
                return None
        causes, sizes, changes = [], [], [np.zeros(len(plain)) for plain in self.plain]
        for name in (first, second) if self.kind == "two" else (first,):
            full = LIBRARY[name].sizes(self.positions[0].disk, self.bench.courses[0], rng)

            def values(share: float, name: str = name, full: Sequence[float] = full) -> list[float]:
                return [v if FIXED_VALUES.get(name) == k else share * v for k, v in enumerate(full)]

            sized = self._sized(rng, lambda share, name=name, values=values: self._angles(name, values(share)))
            if not sized:
                return None
            share, angles, size = sized
            causes.append({"name": name, "values": values(share), "size": size})
            sizes.append(size)
            changes = [total + angle - plain for total, angle, plain in zip(changes, angles, self.plain, strict=True)]
        joined = ";".join(cause["name"] for cause in causes)
        return {"truth": joined, "size": min(sizes), "causes": causes}, [
            plain + change for plain, change in zip(self.plain, changes, strict=True)
        ]

    def _outside(self, rng: np.random.Generator) -> tuple[dict[str, Any], list[Real]] | None:
        law = drawn_law(rng)
        largest = LARGEST_SHARE * self.sense_of(law)
        if not largest:
            return None
        sized = self._sized(rng, lambda share: [law.angle(position, share * largest) for position in self.positions])
        if not sized:
            return None
        share, angles, size = sized
        if min(work_taken(at.course, angle) for at, angle in zip(self.positions, angles, strict=True)) < -NO_WORK:
            return None
        facts = {"name": "drawn law", "values": [share], "law": asdict(law), "size": size}
        apart = self.apart(angles)
        return {"truth": "outside", "size": size, "causes": [facts], "apart": apart}, angles

    def sense_of(self, law: DrawnLaw) -> float:
        """Sense of a law in which every loop takes work, or none gives any; 0 where there is no such sense."""
        for sense in (1.0, -1.0):
            taken = [work_taken(at.course, law.angle(at, LARGEST_SHARE * sense)) for at in self.positions]
            if min(taken) >= -NO_WORK:
                return sense
        return 0.0

    def apart(self, angles: Sequence[Real]) -> float:
        """Distance [noise of a cell] of what was put in from the nearest effect of the simulator's own library."""
        goal = self.cells([angle - plain for angle, plain in zip(angles, self.plain, strict=True)])
        stretch, least = self.cells(self.plain), np.inf
        rng = np.random.default_rng(0)
        for name in LIBRARY:
            if not self._testable(name):
                continue
            full = LIBRARY[name].sizes(self.positions[0].disk, self.bench.courses[0], rng)
            columns = [stretch]
            sides = [full] if len(full) == 1 or name in FIXED_VALUES else [(full[0], 0.0), (0.0, full[1])]
            for side in sides:
                values = [v if FIXED_VALUES.get(name) == k else 0.1 * v for k, v in enumerate(side)]
                try:
                    angles_with = self._angles(name, values)
                except UnbalancedError:
                    continue
                columns.append(self.cells([a - p for a, p in zip(angles_with, self.plain, strict=True)]))
            matrix = np.column_stack(columns)
            left = goal - matrix @ np.linalg.lstsq(matrix, goal, rcond=None)[0]
            least = min(least, float(np.sqrt(np.mean(left**2))))
        return least

    def write(self, folder: Path) -> None:
        """Files of the unit; nothing of the truth."""
        rng = np.random.default_rng(self._of_noise)
        bench, tables = self.bench, []
        zero = rng.normal(0, 5, len(self.positions))
        for number, (position, angle) in enumerate(zip(self.positions, self.angles, strict=True)):
            course, n = position.course, len(angle)
            kicks = np.sqrt(1 - bench.kept**2) * rng.standard_normal(n)
            noise = bench.noise * lfilter([1.0], [1.0, -bench.kept], kicks)
            read = angle + noise + (zero[0] if bench.common_zero else zero[number])
            columns = {
                "cycle": course.cycle,
                "crank_deg": bench.cranks[number],
                "torque_Nm": np.round(course.torque + bench.torque_noise * rng.standard_normal(n), 6),
                "angle_arcmin": np.round(bench.angle_step * np.round(read / bench.angle_step), 8),
                "time_s": np.round(course.time, 4),
            }
            if bench.warmed:
                columns["temperature_C"] = np.round(20 + course.warmer[course.cycle] + 0.1 * rng.standard_normal(n), 2)
            tables.append(pd.DataFrame(columns))
        folder.mkdir(parents=True, exist_ok=True)
        pd.concat(tables, ignore_index=True).to_csv(folder / "data.csv", index=False)
        offset = "common" if bench.common_zero else "per_position"
        for name, text in written_files(self.parts, folder.name, offset, bench.angle_step, rng).items():
            (folder / name).write_text(text, encoding="utf-8")


def _one_of_the_drive(first: str, second: str) -> tuple[str, str]:
    """Two causes whose changes add: at most one of them changes the disk, and one adds to the angle."""
    adds = ("output_torsion", "rayleigh", "creep", "angle_drift")
    if second in adds:
        return first, second
    return (second, first) if first in adds else (first, "")


def drawn_unit(seed: int, case: int, designs: Mapping[str, Any], elastic: bool | None = None) -> Unit:
    """The unit of a case; the same for the same seed, whatever else is drawn.

    Raises
    ------
    RuntimeError : no draw of the case can be solved.
    """
    for attempt in range(TRIES):
        try:
            return Unit(seed, case, attempt, designs, elastic)
        except UnbalancedError:
            continue
    raise RuntimeError(f"case {case}: no solvable unit in {TRIES} draws")


__all__ = ["DrawnLaw", "Unit", "drawn_unit", "kind_of"]
