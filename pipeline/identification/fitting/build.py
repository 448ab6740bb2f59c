"""From a unit's files to the problem that is fitted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline import assembly
from pipeline.config.designs.design import Design
from pipeline.config.studies.study import Study
from pipeline.identification.bench.simulator import BEYOND, Course, Forward
from pipeline.identification.fitting.cell_torques import within_cells
from pipeline.identification.fitting.cells_in_noise import data_of
from pipeline.identification.fitting.offered import offered
from pipeline.identification.fitting.plausible_range import LAWS, plausible_range
from pipeline.identification.fitting.problem import PriorModes, Problem, first_states
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import UnitFile
from pipeline.model.contact.laws import scaled
from pipeline.model.effects import Conditions
from pipeline.model.geometry.clearance import Errors
from pipeline.model.geometry.contacts import PIN
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.load_history.drive import Drive
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
GAP_FIELDS = ("kind", "gap", "two_sided", "per_eccentricity")
"""Of a contact: what its gap is made of beside the flank and the errors."""
TRIAL = 1.01
"""Factor of a calibrated number by which it is seen whether contacts move with it."""
KEPT_SCALES = 64
"""Factors of the calibrated numbers of which the drives of all positions are kept."""
RESOLUTION = 0.2
"""Share of the noise floor below which a mode of the tolerances is left out."""


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
        *path, field = key.split(".")
        section = raw
        for name in path:
            section = section[name]
        section[field] *= scale
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
    return replace(drive, laws=scaled(drive.laws, factor), known=drive.gap_of_errors)


def _with_gaps(drive: Drive, known_drive: Drive | None = None) -> Drive:
    """The drive, its states alike, with the gaps of one of them; those of ``known_drive`` where that has the same."""
    if known_drive is not None and _same_gaps(drive, known_drive):
        return replace(drive, known=known_drive.gap_of_errors)
    first_sample = {name: values[:1] for name, values in vars(drive.errors).items()}
    state = replace(
        drive, errors=Errors(**first_sample), shift=drive.shift[:1], bearing_clearance=drive.bearing_clearance[:1]
    )
    return replace(drive, known=np.repeat(state.gap_of_errors, len(drive.bearing_clearance), axis=0))


def _same_gaps(drive: Drive, known_drive: Drive) -> bool:
    """Whether two drives with the same errors at one crank angle differ in nothing that gaps are made of."""
    contacts, counterparts = drive.reducer.contacts, known_drive.reducer.contacts
    return drive.profile == known_drive.profile and all(
        np.array_equal(getattr(contacts, name), getattr(counterparts, name)) for name in GAP_FIELDS
    )


def _repeated(errors: Errors, n: int) -> Errors:
    return Errors(**{name: np.repeat(values[:1], n, axis=0) for name, values in vars(errors).items()})


def softness(design: Design) -> float:
    """The compliance of the disk is in proportion to this."""
    return 1 / (design.materials[design.disk.material].youngs_modulus_MPa * design.disk.thickness_mm)


def _places(design: Design, key: str, crank_deg: float) -> bool:
    """Whether the number at ``key`` moves any contact of the design, or turns it: else its reducer is kept."""
    declared, moved = (
        vars(assembly.reducer(drawn, crank_deg).contacts) for drawn in (design, scaled_design(design, [key], [TRIAL]))
    )
    return not all(np.array_equal(values, moved[name]) for name, values in declared.items())


def _drives_of(
    study: Study,
    keys: Sequence[str],
    sampled: SampledErrors,
    cranks: Real,
    compliances: Sequence[Real],
    conditions: Sequence[Conditions],
) -> Callable[[tuple[float, ...], int], Drive]:
    """Drive of a position at factors of the numbers at ``keys`` and of the two force laws; made once each."""
    declared = (1.0,) * len(keys)
    placing = [_places(study.design, key, float(cranks[0])) for key in keys]
    counts = [len(position.cycle) for position in conditions]
    errors = [_repeated(assembly.errors(sampled), count) for count in counts]
    clearances = [np.repeat(sampled.bearing_clearance, count, axis=0) for count in counts]
    kept_drives = KEPT_SCALES * len(cranks)

    @lru_cache(maxsize=KEPT_SCALES)
    def scaled_study(numbers: tuple[float, ...]) -> Study:
        return study.model_copy(update={"design": scaled_design(study.design, keys, numbers)}) if keys else study

    @lru_cache(maxsize=kept_drives)
    def reducer(placing_numbers: tuple[float, ...], position: int) -> Reducer:
        return assembly.reducer(scaled_study(placing_numbers).design, float(cranks[position]))

    @lru_cache(maxsize=kept_drives)
    def with_numbers(numbers: tuple[float, ...], position: int) -> Drive:
        refined = scaled_study(numbers)
        drive = drive_of(
            refined,
            float(cranks[position]),
            softness(refined.design) / softness(study.design) * compliances[position],
            errors[position],
            assembly.bearing_clearance(refined.design, clearances[position]),
            reducer=reducer(
                tuple(number if places else 1.0 for number, places in zip(numbers, placing, strict=True)), position
            ),
        )
        return _with_gaps(drive, None if numbers == declared else with_numbers(declared, position))

    @lru_cache(maxsize=4 * kept_drives)
    def drive(scales: tuple[float, ...], position: int) -> Drive:
        return _with_laws(with_numbers(scales[: len(keys)], position), *scales[len(keys) :])

    return drive


def build_problem(measurement: Measurement, compliances: Sequence[Real], visible: Truth | None = None) -> Problem:
    """The problem of a measured unit.

    Parameters
    ----------
    compliances : per position (n_contacts, n_contacts) [mm/N].
    visible : (n_cells,) training cells, all by default: of the others nothing enters noise, bounds, modes and what is
        tested.
    """
    unit, rows = measurement.unit, measurement.rows
    study = unit.study
    states, conditions = _states(measurement)
    visible_cells = np.ones(len(measurement.cells), bool) if visible is None else visible
    courses = [_course(measurement, states, position, visible_cells) for position in range(len(rows.cranks))]
    keys = refitted(study.design)
    unit_dimensions = one_unit(study, unit.dimensions)
    sampled = draw(unit_dimensions, 0, 1) if unit.dimensions is not None else _usual(_population(study))
    drives = _drives_of(study, keys, sampled, measurement.drive_cranks, compliances, conditions)
    rated = study.design.cycloid.rated_torque_Nm
    nmm = assembly.NMM_PER_NM * rated
    reach = _reach(courses, np.unique(measurement.cells.position[visible_cells]))
    stateless = Forward([course.without_states() for course in courses], nmm, reach)
    ranges = np.array([plausible_range(study.design, key).log for key in keys] + [LAWS.log] * 2).T
    by_state = Forward(courses, nmm, reach)
    nominal = first_states([drives((1.0,) * ranges.shape[1], position) for position in range(len(rows.cranks))])
    population = [drive.with_errors(_population_errors(unit, nominal)).gap for drive in nominal]
    influences = tuple(stateless.backbone(drive).influence[0] for drive in nominal)

    components = PriorModes.of(population, influences)

    def trained_on(training: Truth) -> Problem:
        data = data_of(measurement, training)
        modes = components.above(RESOLUTION * data.noise)
        return Problem(
            data=data,
            training=training,
            trained_on=trained_on,
            forward=stateless,
            forward_by_state=by_state,
            drives=drives,
            calibrated=keys,
            scale_range=ranges,
            modes=modes,
            influences=influences,
            compliances=tuple(compliances),
            conditions=tuple(conditions),
            offered=offered(measurement, training),
            rated_torque=rated,
        )

    return trained_on(visible_cells)


def _states(measurement: Measurement) -> tuple[list[NDArray[np.int64]], list[Conditions]]:
    """State of every leg of each position, and the conditions of each state: one per cycle."""
    rows, blocks, cells, turns = measurement.rows, measurement.branches, measurement.cells, measurement.history
    states, conditions = [], []
    for position in range(len(rows.cranks)):
        of_position = blocks.position == position
        cycles = np.unique(blocks.cycle[of_position])
        leg_state = np.full(len(turns.torque[position]) - 1, -1)
        leg_state[turns.leg[of_position]] = np.searchsorted(cycles, blocks.cycle[of_position])
        for leg in range(len(leg_state)):  # between two cycles: as the one before
            if leg_state[leg] < 0:
                leg_state[leg] = leg_state[leg - 1] if leg else 0
        states.append(leg_state)
        rise = np.zeros(len(cycles))
        if rows.temperature is not None:
            temperatures = [
                cells.temperature_mean[(cells.position == position) & (cells.cycle == cycle)] for cycle in cycles
            ]
            rise = np.array(
                [
                    np.nanmean(cell_temperatures) if np.any(np.isfinite(cell_temperatures)) else np.nan
                    for cell_temperatures in temperatures
                ]
            )
            rise = np.nan_to_num(rise - measurement.unit.settings.environment.temperature_C)
        conditions.append(Conditions((cycles - cycles[0]).astype(float), rise))
    return states, conditions


def _reach(courses: Sequence[Course], trained: NDArray[np.int64]) -> float:
    """Largest torque [N m] that the curves are solved for: that of trained positions, unless others go far beyond."""
    tops = np.array([np.max(np.abs(course.torque)) for course in courses])
    top = float(np.max(tops[trained]))
    return top if np.max(tops) <= BEYOND * top else float(np.max(tops))


def _course(measurement: Measurement, states: Sequence[NDArray[np.int64]], position: int, visible: Truth) -> Course:
    unit, cells, turns = measurement.unit, measurement.cells, measurement.history
    of_position = cells.position == position
    crank, lobes = np.radians(measurement.drive_cranks[position]), unit.study.design.cycloid.lobes
    timed = bool(np.all(np.isfinite(cells.time_mean)))
    time = (
        cells.time_mean[of_position] - np.min(cells.time_mean[visible]) if timed else np.zeros(int(of_position.sum()))
    )
    at_input = unit.settings.locked == "output"
    return Course(
        torque=turns.torque[position],
        leg=turns.leg[cells.block[of_position]],
        state=states[position],
        at=within_cells(measurement, np.flatnonzero(of_position)),
        time=time,
        encoder_turns=float(lobes) if at_input else 1.0,
        encoder_place=float(crank if at_input else -crank / lobes),
    )


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
