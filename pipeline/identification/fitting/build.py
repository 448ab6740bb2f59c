"""From a unit's files to the problem that is fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline import assembly
from pipeline.config.design import Design
from pipeline.config.study import Study
from pipeline.identification.bench.simulator import Course, Forward
from pipeline.identification.fitting.plausible_range import LAWS, plausible_range
from pipeline.identification.fitting.problem import FEWEST_CRANKS, Data, Problem, first_states, prior_modes
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import UnitFile
from pipeline.model.effects import Conditions
from pipeline.model.effects.effect import CRANKS, CYCLES, STILL, TEMPERATURE, TIME
from pipeline.model.geometry.clearance import Errors
from pipeline.model.geometry.reducer import PIN
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.load_cycle import ARCMIN
from pipeline.mounting import drive_of
from pipeline.sampling import Errors as SampledErrors
from pipeline.sampling import draw

Real = NDArray[np.float64]
Truth = NDArray[np.bool_]

MESHED = ("cycloid.", "disk.bore_radius_mm", "housing.")
"""Calibrated numbers that a fit leaves alone: each value would need its own mesh."""
MEASURED_UM = 0.3
"""Standard uncertainty of a measured dimension, its part common to all pins and its own part alike."""
POPULATION = 192
"""Units drawn from the study's distributions where the dimensions are not measured."""
RESOLUTION = 0.2
"""Share of the noise floor below which a mode of the tolerances is left out."""
JUMP = 2.0
"""Scatter within a cell over the usual one beyond which the angle jumped in it: through the play, or a slip."""
PARTS = 5
"""Parts of a cell, of as many rows each, over which its angle is averaged: the curve is bent within it."""
CELL_WIDTH = 0.02
"""Error of a cell's torque as a share of the distance to its neighbours."""


def refitted(design: Design) -> tuple[str, ...]:
    """Keys of the calibrated numbers that can be refitted without a new mesh."""
    return tuple(
        sorted(
            key
            for key, provenance in design.provenance.items()
            if provenance.status == "calibrated" and not key.startswith(MESHED)
        )
    )


def scaled_design(design: Design, keys: Sequence[str], scales: Sequence[float]) -> Design:
    """The design with the numbers at ``keys`` times their scales."""
    raw = design.model_dump()
    for key, scale in zip(keys, scales, strict=True):
        *path, last = key.split(".")
        section = raw
        for name in path:
            section = section[name]
        section[last] *= scale
    return Design.model_validate(raw)


def one_unit(study: Study, dimensions: object) -> Study:
    """The study with the as-measured dimensions (or none at all) as its one sample."""
    cases = (dimensions,) if dimensions is not None else ()
    samples = study.samples.model_copy(
        update={"experiment": "cases" if cases else "monte_carlo", "count": 1, "nominal_first": not cases}
    )
    return study.model_copy(update={"samples": samples, "cases": cases})


def _with_laws(drive: Drive, pins: float, output: float) -> Drive:
    """The drive with the local deflections of its pins and of its output's contacts scaled."""
    factor = np.where(drive.reducer.contacts.kind == PIN, pins, output)
    laws = drive.laws
    scaled = {name: factor * getattr(laws, name) for name in ("linear", "logarithmic", "power")}
    return replace(drive, laws=replace(laws, **scaled), known=drive.gap_of_errors)


def _repeated(errors: Errors, n: int) -> Errors:
    return Errors(**{name: np.repeat(values[:1], n, axis=0) for name, values in vars(errors).items()})


def softness(design: Design) -> float:
    """The compliance of the disk is in proportion to this."""
    return 1 / (design.materials[design.disk.material].youngs_modulus_MPa * design.disk.thickness_mm)


def build_problem(measurement: Measurement, compliances: Sequence[Real], seen: Truth | None = None) -> Problem:
    """The problem of a measured unit.

    Parameters
    ----------
    compliances : per position (n_contacts, n_contacts) [mm/N].
    seen : (n_cells,) training cells, all by default: of the others nothing enters noise, bounds, modes and what can be
        tested.
    """
    unit, rows = measurement.unit, measurement.rows
    study = unit.study
    states, conditions = _states(measurement)
    courses = [_course(measurement, states, position) for position in range(len(rows.cranks))]
    keys = refitted(study.design)
    own = one_unit(study, unit.dimensions)
    sampled = draw(own, 0, 1) if unit.dimensions is not None else _usual(_population(study))
    errors = assembly.errors(sampled)

    @lru_cache(maxsize=64)
    def with_numbers(numbers: tuple[float, ...]) -> tuple[Drive, ...]:
        scaled = study.model_copy(update={"design": scaled_design(study.design, keys, numbers)}) if keys else study
        factor = softness(scaled.design) / softness(study.design)
        return tuple(
            drive_of(
                scaled,
                float(crank),
                factor * compliance,
                _repeated(errors, len(at.cycle)),
                assembly.bearing_clearance(scaled.design, np.repeat(sampled.bearing_clearance, len(at.cycle), axis=0)),
            )
            for crank, compliance, at in zip(rows.cranks, compliances, conditions, strict=True)
        )

    @lru_cache(maxsize=256)
    def drives(scales: tuple[float, ...]) -> tuple[Drive, ...]:
        laws = scales[len(keys) :]
        return tuple(_with_laws(drive, *laws) for drive in with_numbers(scales[: len(keys)]))

    rated = study.design.cycloid.rated_torque_Nm
    nmm = assembly.NMM_PER_NM * rated
    plain = Forward([course.without_states() for course in courses], nmm)
    ranges = np.array([plausible_range(study.design, key).log for key in keys] + [LAWS.log] * 2).T
    by_state = Forward(courses, nmm)
    nominal = first_states(drives((1.0,) * ranges.shape[1]))
    population = [drive.with_errors(_population_errors(unit, nominal)).gap for drive in nominal]
    influences = tuple(plain.backbone(drive).influence[0] for drive in nominal)

    def trained_on(training: Truth) -> Problem:
        data = data_of(measurement, training)
        modes = prior_modes(population, influences, RESOLUTION * data.noise)
        return Problem(
            data=data,
            training=training,
            trained_on=trained_on,
            forward=plain,
            forward_by_state=by_state,
            drives=drives,
            calibrated=keys,
            scale_range=ranges,
            modes=modes,
            influences=influences,
            compliances=tuple(compliances),
            conditions=tuple(conditions),
            offered=_offered(measurement, training),
            rated_torque=rated,
        )

    return trained_on(np.ones(len(measurement.cells), bool) if seen is None else seen)


def _states(measurement: Measurement) -> tuple[list[NDArray[np.int64]], list[Conditions]]:
    """State of every leg of each position, and the conditions of each state: one per cycle."""
    rows, blocks, cells, turns = measurement.rows, measurement.branches, measurement.cells, measurement.history
    states, conditions = [], []
    for position in range(len(rows.cranks)):
        mine = blocks.position == position
        cycles = np.unique(blocks.cycle[mine])
        leg_state = np.full(len(turns.torque[position]) - 1, -1)
        leg_state[turns.leg[mine]] = np.searchsorted(cycles, blocks.cycle[mine])
        for leg in range(len(leg_state)):  # between two cycles: as the one before
            if leg_state[leg] < 0:
                leg_state[leg] = leg_state[leg - 1] if leg else 0
        states.append(leg_state)
        rise = np.zeros(len(cycles))
        if rows.temperature is not None:
            at = [cells.temperature_mean[(cells.position == position) & (cells.cycle == cycle)] for cycle in cycles]
            rise = np.array([np.nanmean(one) if np.any(np.isfinite(one)) else np.nan for one in at])
            rise = np.nan_to_num(rise - measurement.unit.settings.environment.temperature_C)
        conditions.append(Conditions((cycles - cycles[0]).astype(float), rise))
    return states, conditions


def _course(measurement: Measurement, states: Sequence[NDArray[np.int64]], position: int) -> Course:
    unit, rows, cells, turns = measurement.unit, measurement.rows, measurement.cells, measurement.history
    mine = cells.position == position
    crank, lobes = np.radians(rows.cranks[position]), unit.study.design.cycloid.lobes
    timed = bool(np.all(np.isfinite(cells.time_mean)))
    time = cells.time_mean[mine] - np.min(cells.time_mean) if timed else np.zeros(int(mine.sum()))
    at_input = unit.settings.locked == "output"
    return Course(
        torque=turns.torque[position],
        leg=turns.leg[cells.block[mine]],
        state=states[position],
        at=within_cells(measurement, np.flatnonzero(mine)),
        time=time,
        encoder_turns=float(lobes) if at_input else 1.0,
        encoder_place=float(crank if at_input else -crank / lobes),
    )


def within_cells(measurement: Measurement, numbers: NDArray[np.intp]) -> Real:
    """Torques within cells (n, PARTS + 1) [N m], as many rows between any two; each row stands for its surroundings."""
    rows, cells, kept = measurement.rows, measurement.cells, np.flatnonzero(measurement.usable)
    first = np.searchsorted(kept, cells.first_row[numbers])
    shares = np.arange(PARTS + 1) / PARTS
    found = []
    for start, count in zip(first, cells.count[numbers], strict=True):
        torque = np.sort(rows.torque[kept[start : start + count]])
        low, high = 0.5 * (torque[1] - torque[0]), 0.5 * (torque[-1] - torque[-2])
        known = np.concatenate([[torque[0] - low], torque, [torque[-1] + high]])
        places = np.concatenate([[0.0], (np.arange(count) + 0.5) / count, [1.0]])
        found.append(np.interp(shares, places, known))
    return np.array(found)


def followed_torques(measurement: Measurement) -> Real:
    """Torques (n_cells, PARTS) [N m] that each cell went through, in time order: middles of parts of as many rows."""
    edges = within_cells(measurement, np.arange(len(measurement.cells)))
    middles = 0.5 * (edges[:, 1:] + edges[:, :-1])
    return np.where(measurement.cells.direction[:, None] > 0, middles, middles[:, ::-1])


def data_of(measurement: Measurement, training: Truth) -> Data:
    """The cells of a measurement with their noise, which is that of the training cells (n_cells,)."""
    unit, blocks = measurement.unit, measurement.branches
    cells, noise = measurement.cells, measurement.noise_of(training)
    resolution = (unit.settings.instrument.angle_resolution_arcmin or 0.0) / np.sqrt(12)
    known = [
        value
        for value in (noise.random.value, noise.floor.value, noise.within_branch.value)
        if np.isfinite(value) and value > 0
    ]
    floor = max(known[0] if known else 0.0, resolution, 1e-4)
    slope, width = np.zeros(len(cells)), np.zeros(len(cells))
    for block in np.unique(cells.block):
        mine = np.flatnonzero(cells.block == block)
        if len(mine) < 3:
            continue
        torque, angle = cells.torque_mean[mine], cells.angle_mean[mine]
        step = np.maximum(np.abs(np.diff(torque)), 1e-9)
        between = np.abs(np.diff(angle)) / step
        slope[mine] = np.maximum(np.append(between, 0.0), np.append(0.0, between))
        width[mine] = np.maximum(np.append(step, 0.0), np.append(0.0, step))
    torque_noise = np.nan_to_num(noise.torque_noise_Nm) / np.sqrt(cells.count)
    usual = np.median(cells.angle_spread[training & np.isfinite(cells.angle_spread)])
    jumps = np.maximum(np.nan_to_num(cells.angle_spread) ** 2 - (JUMP * usual) ** 2, 0.0)
    usual_share = np.mean(1 / cells.count[training])
    white = min(np.nan_to_num(noise.row_scatter_arcmin), floor / np.sqrt(usual_share))
    own = floor**2 + white**2 * (1 / cells.count - usual_share)
    sigma = np.sqrt(own + slope**2 * (torque_noise**2 + (CELL_WIDTH * width) ** 2) + jumps)
    return Data(
        position=cells.position,
        cycle=cells.cycle,
        block=cells.block,
        branch=np.unique(np.column_stack([blocks.position, blocks.kind]), axis=0, return_inverse=True)[1].ravel()[
            cells.block
        ],
        torque=cells.torque_mean,
        angle=cells.angle_mean,
        count=cells.count,
        spread=cells.angle_spread,
        noise=floor,
        sigma=sigma,
        common_offset=unit.settings.offset == "common",
    )


def _offered(measurement: Measurement, training: Truth) -> frozenset[str]:
    """What the training cells (n_cells,) have of what effects need."""
    unit, rows, cells = measurement.unit, measurement.rows, measurement.cells
    offered = set()
    gear, position, cycle = unit.study.design.cycloid, cells.position[training], cells.cycle[training]
    positions, angle = np.unique(position), cells.angle_mean[training]
    turned = max(np.ptp(angle[position == p]) for p in positions) * gear.lobes / ARCMIN
    if unit.settings.locked == "input" or turned < np.pi / gear.pins:
        offered.add(STILL)
    if len(positions) >= FEWEST_CRANKS:
        offered.add(CRANKS)
    if any(len(np.unique(cycle[position == p])) > 1 for p in positions):
        offered.add(CYCLES)
    time, temperature = cells.time_mean[training], cells.temperature_mean[training]
    if rows.time is not None and np.any(np.isfinite(time)) and np.nanstd(time) > 0:
        offered.add(TIME)
    if rows.temperature is not None and np.nanstd(temperature) > 0.2:
        offered.add(TEMPERATURE)
    return frozenset(offered)


def _measured(errors: Errors) -> Errors:
    """Units (POPULATION) that a measurement of one cannot tell from it."""
    rng = np.random.default_rng(POPULATION)
    unit = assembly.MM_PER_UM * MEASURED_UM

    def spread(values: Real) -> Real:
        common = unit * rng.standard_normal((POPULATION,) + (1,) * (values.ndim - 1))
        return values[:1] + common + (unit * rng.standard_normal((POPULATION, *values.shape[1:])) * (values.ndim > 1))

    return Errors(**{name: spread(values) for name, values in vars(errors).items()})


def _population_errors(unit: UnitFile, drives: Sequence[Drive]) -> Errors:
    """Units that the tolerances make, or that measuring the dimensions cannot tell from this one."""
    return _measured(drives[0].errors) if unit.dimensions is not None else assembly.errors(_population(unit.study))


def _population(study: Study) -> SampledErrors:
    """Errors [um] of units as the study's tolerances make them."""
    samples = study.samples.model_copy(
        update={"experiment": "monte_carlo", "count": POPULATION, "nominal_first": False}
    )
    return draw(study.model_copy(update={"samples": samples, "cases": ()}), 0, POPULATION)


def _usual(population: SampledErrors) -> SampledErrors:
    """The mean unit, about which the modes of the tolerances stand: one-sided tolerances move it from the nominal."""
    return SampledErrors(**{name: values.mean(axis=0, keepdims=True) for name, values in vars(population).items()})
