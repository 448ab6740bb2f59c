"""Units for tests, made by the model itself: a folder as a bench would leave it, and the problem that is fitted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import assembly
from pipeline.config import load_study
from pipeline.config.studies.study import Study
from pipeline.identification.bench.course import Course
from pipeline.identification.bench.load_path import Ripple
from pipeline.identification.bench.simulator import Forward
from pipeline.identification.fitting.build import build_problem
from pipeline.identification.fitting.problem import Model, Problem, candidates
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.model.effects import Conditions
from pipeline.model.units import ARCMIN, NMM_PER_NM
from pipeline.mounting import drive_of
from pipeline.sampling.errors import Errors, draw
from tests.validation.blind.true_unit import with_interpolation

ROOT = Path(__file__).parents[2]
LARGEST = 12.0  # [N m]
CRANKS = (0.0, 40.0, 95.0)
"""Angles at which the disk is condensed."""
EXAMPLE, TRIED = "friction_example", ("coulomb", "load_friction", "preload", "thermal_growth")
"""The measured unit with friction that comes with the project, and the effects that most tests try on it."""
TEMPERATURE = 20.0
UNIT = """
title = "A unit of the tests"
design = "pham2017"
study = "quick"
locked = "{locked}"
offset = "{offset}"
as_measured = "{dimensions}"
{more}
"""
STATES_A_CYCLE = 24
"""Pieces of a cycle in which wear and temperature stand still."""
LISTED = ("pin_radial", "pin_tangential", "pin_radius", "lobe_profile", "roller_diameter")
SINGLE = ("disk_profile", "eccentricity", "bearing_clearance")

Condensed = Callable[[Study, Sequence[float]], list[np.ndarray]]


@dataclass(frozen=True)
class Bench:
    """How a unit is measured."""

    cranks: tuple[float, ...] = (0.0, 40.0)
    cycles: int = 2
    rows: int = 60
    noise: float = 0.004
    seconds: float = 1.0
    warming: float = 0.0
    common: bool = False
    locked: str = "input"
    known: bool = True
    more: str = ""
    sample: int = 3
    seed: int = 1

    @property
    def turns(self) -> np.ndarray:
        """Torques [N m] at which it turns: 0, then +-T in every cycle, then 0."""
        return np.array([0.0, *[LARGEST, -LARGEST] * self.cycles, 0.0])

    @property
    def state(self) -> np.ndarray:
        """Cycle of every leg."""
        return np.minimum(np.arange(len(self.turns) - 1) // 2, self.cycles - 1)


def _model_of(effects: Mapping[str, Sequence[float]], n_positions: int) -> Model:
    """The effects by their names; one with more values than parameters has its own phase at each position."""
    library = candidates()
    own_phases = any(len(values) > len(library[name].parameters) for name, values in effects.items())
    return Model(tuple(library[name].of_positions(n_positions) if own_phases else library[name] for name in effects))


def _wear_of(torque: np.ndarray, cycles: int, by_state: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cycles travelled at each row (n_rows,), state of each row, and cycles travelled in each state."""
    way = np.cumsum(np.abs(np.gradient(torque)))
    travelled = cycles * way / way[-1]
    part = STATES_A_CYCLE * travelled if by_state else np.zeros(len(way))
    state = np.unique(np.floor(part), return_inverse=True)[1]
    return travelled, state, np.bincount(state, travelled) / np.bincount(state)


def make_unit(folder: Path, effects: Mapping[str, Sequence[float]], bench: Bench, condensed: Condensed) -> Path:
    """A unit's folder: one drawn from the quick study, with the ``effects`` by their names and values."""
    rng = np.random.default_rng(bench.seed)
    study = load_study("quick", ROOT)
    sampled = draw(study, bench.sample, bench.sample + 1)
    item = assembly.errors(sampled)
    model = _model_of(effects, len(bench.cranks))
    values = [value for own_value in effects.values() for value in own_value]
    torque = np.concatenate(
        [np.linspace(a, b, bench.rows, endpoint=False) for a, b in zip(bench.turns[:-1], bench.turns[1:], strict=True)]
    )
    leg = np.repeat(np.arange(len(bench.state)), bench.rows)
    time = bench.seconds * np.arange(len(torque))
    travelled, state, number = _wear_of(torque, bench.cycles, model.by_state)
    conditions = Conditions(number, bench.warming * number)
    errors = type(item)(**{name: np.repeat(values, len(number), axis=0) for name, values in vars(item).items()})
    tables = []
    for crank, compliance in zip(bench.cranks, condensed(study, bench.cranks), strict=True):
        loose = assembly.bearing_clearance(study.design, np.repeat(sampled.bearing_clearance, len(number)))
        drive = drive_of(study, crank, compliance, errors, loose)
        (unit,), instrument = model.put([drive], [conditions], values)
        at_input = bench.locked == "output"
        position, lobes = np.radians(crank), study.design.cycloid.lobes
        course = Course(
            *(bench.turns, leg, state, np.column_stack([torque, torque]), time),
            *((float(lobes), position) if at_input else (1.0, -position / lobes)),
            is_output_locked=at_input,
        )
        courses = [course] * (len(tables) + 1)  # the position is the last of these
        reading = Forward(courses, unit.rated_torque).read(
            (unit,), len(tables), replace(instrument, ripple=Ripple(), interpolation=Ripple())
        )
        assert reading.sound
        offset = 2.0 if bench.common else rng.normal(0, 3)
        angle = with_interpolation(reading.angle + offset, instrument, len(tables))
        rippled = instrument.ripple_at(len(tables)).value((reading.angle + offset) / ARCMIN) / NMM_PER_NM
        cycle = bench.state[leg]
        tables.append(
            pd.DataFrame(
                {
                    "cycle": cycle,
                    "crank_deg": crank,
                    "torque_Nm": torque + rippled,
                    "angle_arcmin": angle + bench.noise * rng.standard_normal(len(torque)),
                    "time_s": time + 1e5 * len(tables),
                    "temperature_C": TEMPERATURE + bench.warming * travelled,
                }
            )
        )
    _write_unit(folder, tables, sampled, bench)
    return folder


def _write_unit(folder: Path, tables: Sequence[pd.DataFrame], sampled: Errors, bench: Bench) -> None:
    folder.mkdir(parents=True)
    pd.concat(tables).to_csv(folder / "rows.csv", index=False)
    lines = [f"{name} = {np.round(getattr(sampled, name)[0], 9).tolist()}" for name in (*LISTED, *SINGLE)]
    (folder / "dimensions.toml").write_text("\n".join(lines), encoding="utf-8")
    (folder / "unit.toml").write_text(
        UNIT.format(
            locked=bench.locked,
            offset="common" if bench.common else "per_position",
            dimensions="dimensions.toml" if bench.known else "unknown",
            more=bench.more,
        ),
        encoding="utf-8",
    )


def problem_of(folder: Path, condensed: Condensed) -> Problem:
    """The problem of a unit's folder, as ``identify`` builds it."""
    unit = load_measured_unit(folder, ROOT)
    measurement = Measurement.read(unit)
    return build_problem(measurement, condensed(unit.study, measurement.rows.cranks.tolist()))


def with_angles(problem: Problem, angle: np.ndarray) -> Problem:
    """The problem with other measured angles."""
    return replace(problem, data=replace(problem.data, angle=angle))


def exactly_known(problem: Problem) -> Problem:
    """The problem with nothing uncertain but its calibrated numbers; dimensions and force laws are as declared."""
    ranges = problem.scale_range.copy()
    ranges[:, len(problem.calibrated_keys) :] *= 1e-4
    return replace(problem, scale_range=ranges, modes=tuple(mode[:0] for mode in problem.modes))
