"""Seeded units with nothing, one or two effects of the library, or one outside it; and their sealed truth."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pipeline import assembly
from pipeline.arrays import Real
from pipeline.config.studies.study import Study
from pipeline.identification.fitting.build import refittable_keys
from pipeline.identification.fitting.problem import candidates
from pipeline.identification.fitting.scaled_drives import scaled_design
from pipeline.sampling.errors import Errors, draw
from tests.validation.blind.bench import draw_bench, rows_a_cell
from tests.validation.blind.catalogue import OFF, CataloguedCompliances, CatalogueReducer, no_compliance
from tests.validation.blind.effect_size import Yardstick, amplitude_of, at_amplitude, draw_shape
from tests.validation.blind.files import rounded, write_truth, write_unit
from tests.validation.blind.outside_effects import OUTSIDE, OutsideEffect
from tests.validation.blind.rigid_drive.readings import readings
from tests.validation.blind.rigid_unit import RigidUnit, machined, rigid_unit
from tests.validation.blind.true_unit import TrueUnit, UnsoundError, true_unit

Compliances = Callable[[Study, Sequence[float]], Sequence[Real]]

NONE, ONE, TWO, OUTSIDE_KIND = "none", "one", "two", "outside"
FULL: Mapping[str, int] = {NONE: 200, ONE: 200, TWO: 60, OUTSIDE_KIND: 60}
"""Units of each kind in the full run; any shorter one keeps the proportions."""
SIZES = 1.0, 30.0
"""Least and largest size of an effect, in noise floors."""
KNOWN_SHARE = 0.7
"""Units whose dimensions were measured."""
UNMEASURED = 0.4
"""Tolerances of the others, as a share of the study's."""
MEASURING_UM = 0.3
"""Standard deviation of a measured dimension, its part common to all pins and its own part alike."""
LARGEST = 0.9
"""Largest amplitude of an effect in its bounds: at a bound nothing may be claimed."""
REDRAWS = 30
"""Draws of a unit until one has equilibria; more would hide a broken design."""
SAMPLES = 10**6
"""Numbers of samples that a unit is taken from: two units share none."""
OUTSIDE_PREFIX = "outside:"
ELASTIC, RIGID, COMPLIANT = "elastic", "rigid", "compliant"
"""Who makes a unit: the model's own physics on another mesh with another law, or one of two simulators that share no
code with it; the third has cases of its own."""


@dataclass(frozen=True)
class Maker:
    """Everything that units are made of, and where they go.

    Attributes
    ----------
    reducers : the catalogue.
    condensed : by name of a reducer, compliances of its model's and of its generating study.
    folder : holds `units` and `truth`.
    """

    reducers: tuple[CatalogueReducer, ...]
    condensed: Mapping[str, tuple[CataloguedCompliances, CataloguedCompliances]]
    folder: Path
    root: Path
    seed: int

    def unit_folder(self, case: int) -> Path:
        return self.folder / "units" / f"{case:04d}"

    def truth_path(self, case: int) -> Path:
        return self.folder / "truth" / f"{case:04d}.json"


def kind_of(case: int) -> str:
    """Kind of a case: every run's first cases have the proportions of the full run as nearly as can be."""
    total = sum(FULL.values())
    counts = dict.fromkeys(FULL, 0)
    kind = NONE
    for k in range(case + 1):
        kind = max(FULL, key=lambda name: FULL[name] * (k + 1) / total - counts[name])
        counts[kind] += 1
    return kind


def simulator_of(case: int) -> str:
    """Which simulator makes a case: of the units of each kind every other one."""
    case_rank = sum(kind_of(previous_case) == kind_of(case) for previous_case in range(case))
    return (ELASTIC, RIGID)[case_rank % 2]


@dataclass(frozen=True)
class Made:
    """A unit that was made, for the oracle alone: the identification reads its files.

    Attributes
    ----------
    unit : without its effect.
    believed, compliances : of the disk as the identification and as the generator's own study have them.
    angles : per position (n_rows,) [arcmin] with the effect, without noise and offset.
    dimensions : one sample [um], unrounded.
    truth : as written.
    """

    reducer: CatalogueReducer
    unit: TrueUnit | RigidUnit
    believed: Compliances
    compliances: Compliances
    angles: Sequence[Real]
    dimensions: Errors
    truth: Mapping[str, Any]


def generate(maker: Maker, case: int) -> Made:
    """Write the unit and the truth of a case; the same for the same seed, whatever else is made.

    Raises
    ------
    RuntimeError : no draw of the case can be solved.
    """
    for attempt in range(REDRAWS):
        try:
            return _Draw(maker, case, attempt).make()
        except UnsoundError:
            continue
    raise RuntimeError(f"case {case}: no solvable unit in {REDRAWS} draws")


def _narrowed(study: Study) -> Study:
    """The study with its tolerances narrower about the same allowances."""
    narrow = {}
    for name in type(study.tolerances).model_fields:
        tolerance = getattr(study.tolerances, name)
        if tolerance.varies:
            narrow[name] = tolerance.scaled_by(UNMEASURED)
    return study.with_section("tolerances", **narrow)


class _Draw:
    """One unit in the making."""

    def __init__(self, maker: Maker, case: int, attempt: int):
        streams = np.random.SeedSequence([maker.seed, case, attempt]).spawn(4)
        unit, bench, self.noise_stream, effect = streams
        self.maker, self.case = maker, case
        self.rng = np.random.default_rng(effect)
        rng = np.random.default_rng(unit)
        self.reducer = maker.reducers[int(rng.integers(len(maker.reducers)))]
        self.known = bool(rng.random() < KNOWN_SHARE)
        self.simulator = simulator_of(case)
        rigid = self.simulator == RIGID
        model = self.reducer.rigid_model if rigid else self.reducer.model
        self.truth = self.reducer.rigid_truth if rigid else self.reducer.truth
        self.believed, self.compliances = (no_compliance,) * 2 if rigid else maker.condensed[self.reducer.name]
        self.study = model if self.known else _narrowed(model)
        sample = int(rng.integers(SAMPLES))
        self.dimensions: Errors = draw(self.study, sample, sample + 1)
        if rigid:
            self.dimensions = machined(self.study, self.dimensions, rng)
        keys = refittable_keys(self.truth.design)
        self.scales = {key: float(np.exp(rng.choice([-1, 1]) * rng.uniform(*np.log(OFF)))) for key in keys}
        rated = self.truth.design.cycloid.rated_torque_Nm
        self.bench = draw_bench(np.random.default_rng(bench), self.reducer.cranks, rated)
        self.unit = self._unit()
        self.plain = self.unit.angles()
        span = max(float(np.ptp(angle)) for angle in self.plain)
        row_noise = self.bench.floor_share * span * float(np.sqrt(rows_a_cell(self.bench)))
        self.noise = row_noise, self.bench.angle_steps * row_noise

    def _unit(self) -> TrueUnit | RigidUnit:
        keys, scales = tuple(self.scales), tuple(self.scales.values())
        if self.simulator == RIGID:
            numbers = self.truth.model_copy(update={"design": scaled_design(self.truth.design, keys, scales)})
            return rigid_unit(numbers, self.dimensions, self.bench)
        return true_unit(
            self.truth,
            keys,
            scales,
            assembly.errors(self.dimensions),
            float(self.dimensions.bearing_clearance[0]),
            self.compliances(self.truth, self.bench.cranks),
            self.bench,
        )

    def make(self) -> Made:
        """Write the unit without effect, choose the effect by its size over it, and write it again with the effect."""
        self._write(self.plain)
        kind, angles = kind_of(self.case), self.plain
        effect_facts: dict[str, Any] = {"truth": NONE, "size_over_noise": 0.0, "effects": []}
        if kind != NONE:
            yardstick = Yardstick.of(self.maker.unit_folder(self.case), self.maker.root, self.believed)
            angles, effect_facts = self._outside(yardstick) if kind == OUTSIDE_KIND else self._library(yardstick, kind)
            self._write(angles)
        truth = {
            **effect_facts,
            "case": self.case,
            "seed": self.maker.seed,
            "kind": kind,
            "reducer": self.reducer.name,
            "simulator": self.simulator,
            "dimensions_known": self.known,
            "scales": self.scales,
            "row_noise_arcmin": self.noise[0],
            "dimensions_um": {k: np.asarray(v[0]).tolist() for k, v in vars(self.dimensions).items()},
        }
        write_truth(self.maker.truth_path(self.case), truth)
        return Made(self.reducer, self.unit, self.believed, self.compliances, angles, self.dimensions, truth)

    def _write(self, angles: Sequence[Real]) -> None:
        write_unit(
            self.maker.unit_folder(self.case),
            self.study,
            self.bench,
            angles,
            self.noise,
            np.random.default_rng(self.noise_stream),
            dimensions=self.dimensions if self.known else None,
            measuring_um=MEASURING_UM,
            reading=readings if self.simulator == RIGID else rounded,
        )

    def _target(self) -> float:
        low, high = np.log(SIZES)
        return float(np.exp(self.rng.uniform(low, high)))

    def _change(self, angles: Sequence[Real]) -> list[Real]:
        return [angle - bare_angle for angle, bare_angle in zip(angles, self.plain, strict=True)]

    @staticmethod
    def _sought(size: Callable[[float], float], target: float) -> tuple[float, float] | None:
        """Amplitude and size; None too where some unit on the way has no solution."""
        try:
            return amplitude_of(size, target)
        except UnsoundError:
            return None

    def _library(self, yardstick: Yardstick, kind: str) -> tuple[list[Real], dict[str, Any]]:
        known = {name: effect for name, effect in candidates().items() if self.unit.knows(name)}
        library = yardstick.problem.candidates_for(known, yardstick.problem.training)
        chosen: dict[str, tuple[tuple[float, ...], float]] = {}
        effect_count = 2 if kind == TWO else 1
        for _ in range(REDRAWS):
            if len(chosen) == effect_count:
                break
            name = str(self.rng.choice([effect for effect in sorted(library) if effect not in chosen]))
            bounds = yardstick.problem.bounds(library[name])
            direction, shape = draw_shape(self.rng, bounds)
            target, record = self._target(), yardstick.problem.record
            constants = zip(library[name].parameters, at_amplitude(bounds, 1.0, direction, shape), strict=True)
            if any(p.record and value > record[p.record] for p, value in constants):  # nothing may be claimed of it
                continue

            values_at = partial(at_amplitude, bounds, direction=direction, shape=shape)

            def size(
                amplitude: float, name: str = name, values_at: Callable[[float], tuple[float, ...]] = values_at
            ) -> float:
                return yardstick.size(self._change(self.unit.angles([library[name]], values_at(amplitude))))

            trial_amplitude = self._sought(size, target)
            if trial_amplitude and trial_amplitude[0] <= LARGEST:
                chosen[name] = at_amplitude(bounds, trial_amplitude[0], direction, shape), trial_amplitude[1]
        if len(chosen) < effect_count:
            raise UnsoundError("no effect reaches its size")
        values = [value for values_of_effect, _ in chosen.values() for value in values_of_effect]
        angles = self.unit.angles([library[name] for name in chosen], values)
        effects = [
            {
                "name": name,
                "values": list(values_of_effect[: len(candidates()[name].parameters)]),
                "values_of_positions": list(values_of_effect[len(candidates()[name].parameters) :]),
                "size_over_noise": size,
            }
            for name, (values_of_effect, size) in chosen.items()
        ]
        smallest_size = min(size for _, size in chosen.values())
        return angles, {"truth": ";".join(chosen), "size_over_noise": smallest_size, "effects": effects}

    def _outside(self, yardstick: Yardstick) -> tuple[list[Real], dict[str, Any]]:
        for _ in range(REDRAWS):
            effect = OUTSIDE[int(self.rng.integers(len(OUTSIDE)))]
            shape, target = effect.shape(self.rng), self._target()

            def size(amplitude: float, effect: OutsideEffect = effect, shape: Mapping[str, float] = shape) -> float:
                return yardstick.size(self._change(self.unit.angles_outside(effect.at(amplitude, shape))))

            trial_amplitude = self._sought(size, target)
            if trial_amplitude:
                angles = self.unit.angles_outside(effect.at(trial_amplitude[0], shape))
                effect_facts = {
                    "name": effect.name,
                    "amplitude": trial_amplitude[0],
                    "shape": dict(shape),
                    "size_over_noise": trial_amplitude[1],
                }
                name = f"{OUTSIDE_PREFIX}{effect.name}"
                return angles, {"truth": name, "size_over_noise": trial_amplitude[1], "effects": [effect_facts]}
        raise UnsoundError("no effect reaches its size")
