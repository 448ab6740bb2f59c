"""From a unit's files to the problem that is fitted."""

from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from pipeline import assembly
from pipeline.arrays import Real, Truth, Whole
from pipeline.config.designs.design import Design, plausible_range
from pipeline.config.dimensions import dimension_library
from pipeline.config.studies.study import LAW_FACTORS, Study
from pipeline.config.studies.tolerances import Case
from pipeline.constant_kinds import Fineness, Rounding
from pipeline.errors import InputError
from pipeline.identification.bench.course import Course, CrankMotion
from pipeline.identification.bench.simulator import BEYOND, Forward
from pipeline.identification.fitting.cells_in_noise import data_of
from pipeline.identification.fitting.measured_loops import readings, rows_within, within_cells
from pipeline.identification.fitting.offered import met_needs
from pipeline.identification.fitting.problem import PriorModes, Problem, first_states
from pipeline.identification.fitting.scaled_drives import drives_of
from pipeline.identification.fitting.stations import Stations, stations_of
from pipeline.identification.measurement.cells import Cells
from pipeline.identification.measurement.enough import SURE
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.turning.turning_measurement import TurningMeasurement
from pipeline.model.effects import Conditions, library
from pipeline.model.effects.effect import LOOPS, RATE, STILL
from pipeline.model.geometry.clearance import Errors
from pipeline.model.load_history.backbone import Backbone
from pipeline.model.units import MM_PER_UM, NMM_PER_NM
from pipeline.sampling.errors import Errors as SampledErrors
from pipeline.sampling.errors import draw, draw_as_measured, usual_beside

MESHED_SECTIONS = ("cycloid.", "disk.bore_radius_mm", "housing.")
"""Calibrated numbers that a fit leaves alone: each value would need its own mesh."""
LOBE_PROFILES = ("disk_profile", "lobe_profile")
"""Dimensions that are one deviation of each lobe's flank."""
POPULATION: Fineness = 192
"""Units drawn from the study's distributions where the dimensions are not measured."""
STRAIGHT: Rounding = 0.02
"""Largest departure from a line between two states: of the logarithm of the cycles travelled, one added, and of the
temperature as a share of its range."""
WAYS, STILL_ALONE = frozenset({LOOPS, RATE, STILL}), frozenset({STILL})
"""Needs of effects that a crank which turns under a held torque, or within a loop, does not meet."""
RESOLUTION = 0.02
"""Share of the noise floor by which the modes of the tolerances that are left out move the nominal curves together."""
BEARING_STIFFNESS = "bearing.stiffness_N_per_mm_power"
"""Key of the stiffness of the input bearing."""


def refittable_keys(design: Design) -> tuple[str, ...]:
    """Keys of the numbers that are refitted: calibrated ones that need no new mesh, and a chosen bearing stiffness.

    No drawing states the stiffness of a bearing, so a chosen one is an estimate, as those of the contacts are.
    """
    return tuple(
        sorted(
            key
            for key, provenance in design.provenance.items()
            if (provenance.status == "calibrated" and not key.startswith(MESHED_SECTIONS))
            or (provenance.status == "chosen" and key == BEARING_STIFFNESS)
        )
    )


def one_unit(study: Study, dimensions: Case) -> Study:
    """The study with these dimensions as its one sample."""
    samples = study.samples.model_copy(update={"experiment": "cases", "count": 1, "nominal_first": False})
    return study.model_copy(update={"samples": samples, "cases": (dimensions,)})


def build_problem(
    measurement: Measurement, compliances: Sequence[Real], visible: Truth | None = None, halvings: int = 0
) -> Problem:
    """The problem of a measured unit.

    Parameters
    ----------
    compliances : per station (``stations_of``) (n_contacts, n_contacts) [mm/N].
    visible : (n_cells,) training cells, all by default; nothing of the others enters noise, bounds, modes and tests.
    halvings : of the distance between the stations.
    """
    unit, study = measurement.unit, measurement.unit.study
    _refuse_paths(measurement)
    states, conditions = _states(measurement)
    visible_cells = np.ones(len(measurement.cells), bool) if visible is None else visible
    stations = stations_of(measurement, halvings)
    courses = [_course(measurement, states, stations, p, visible_cells) for p in range(len(measurement.rows.cranks))]
    at_stations = [conditions[p] for p, numbers in enumerate(stations.of_position) for _ in numbers]
    keys = refittable_keys(study.design)
    case, population_errors = unit.dimensions, _population(study, unit.dimensions)
    mean_study = None if case is None else one_unit(study, usual_beside(study, case))
    sampled_errors = _mean_unit(population_errors) if mean_study is None else draw(mean_study, 0, 1)
    drives = drives_of(study, keys, sampled_errors, stations.cranks, compliances, at_stations)
    nmm = NMM_PER_NM * study.design.cycloid.rated_torque_Nm
    reach = _reach(courses, np.unique(measurement.cells.position[visible_cells]))
    by_state = Forward(courses, nmm, reach)
    stateless = Forward([course.without_states() for course in courses], nmm, reach)
    ranges = _scale_ranges(study, keys, are_short=False)
    nominal = first_states([drives((1.0,) * ranges.shape[1], k) for k in range(len(stations.cranks))])
    errors = _indistinguishable_errors(population_errors, case, unit.settings.measured_to_um)
    influences = _influences(measurement, [stateless.backbone(drive) for drive in nominal])
    components = PriorModes.from_population([drive.with_errors(errors).gap for drive in nominal], influences)

    def trained_on(training: Truth) -> Problem:
        data = data_of(measurement, training)
        modes = components.above(RESOLUTION * data.noise)
        weights = components.weights(RESOLUTION * data.noise)
        return Problem(
            data=data,
            training=training,
            trained_on=trained_on,
            forward=stateless,
            forward_by_state=by_state,
            stations=stations.of_position,
            halvings=halvings,
            drives=drives,
            calibrated_keys=keys,
            scale_range=ranges,
            short_range=_scale_ranges(study, keys, are_short=True),
            modes=modes,
            influences=influences,
            compliances=tuple(compliances),
            conditions=tuple(at_stations),
            met_needs=met_needs(measurement, training),
            rated_torque=study.design.cycloid.rated_torque_Nm,
            mean_unit=sampled_errors,
            modes_of_errors=lambda amounts: _combined_errors(errors, amounts @ weights),
        )

    return trained_on(visible_cells)


def _scale_ranges(study: Study, keys: Sequence[str], are_short: bool) -> Real:
    """Logarithms (2, n_scales) between which the factors of the numbers at ``keys`` and of the laws are plausible.

    The range of a law's factor is that of the whole factor, that of the study included; ``are_short`` says that
    contacts may be on a part of the width.
    """
    of_numbers = np.array([plausible_range(study.design, key).log for key in keys]).reshape(-1, 2)
    ranges = [(factor.if_short if are_short else None) or factor.plausible for factor in LAW_FACTORS]
    of_laws = np.array([of_law.log for of_law in ranges])
    further = of_laws - np.log(assembly.law_factors(study))[:, None]
    further = np.column_stack([np.minimum(further[:, 0], 0.0), np.maximum(further[:, 1], 0.0)])  # its own is plausible
    return np.vstack([of_numbers, further]).T


def _influences(measurement: Measurement, curves: Sequence[Backbone]) -> tuple[Real, ...]:
    """Influence of the gaps on the curve of each station, at the torques that the measurement asks for."""
    nodes = _asked_nodes(measurement, curves[0].torque)
    return tuple(curve.influence[0][nodes] for curve in curves)


def _combined_errors(population: Errors, amounts: Real) -> Errors:
    """Deviations [mm] of a combination of units, with so much (n_units,) of each, from their mean."""
    return Errors(**{name: np.tensordot(amounts, v - v.mean(axis=0), axes=1) for name, v in vars(population).items()})


def _refuse_paths(measurement: Measurement) -> None:
    """Refuse a drive whose declared effects need a way of the torque that its crank does not leave."""
    unit, paths = measurement.unit, WAYS if isinstance(measurement, TurningMeasurement) else frozenset()
    paths = STILL_ALONE if unit.settings.crank.moves != "fixed" else paths
    names = [name for name in unit.study.design.effects if library()[name].needs & paths]
    if names:
        raise InputError(
            f"{unit.name}/unit.toml: design: effects.{', effects.'.join(names)} depend on the path of the torque at a "
            "crank that stands still, and this one turns; leave them out of the design"
        )


def _asked_nodes(measurement: Measurement, torque: Real) -> Whole | slice:
    """Nodes of backbones, at ``torque`` (n_nodes,) [N mm], that are asked for: all, or those of torques held."""
    if not isinstance(measurement, TurningMeasurement):
        return slice(None)
    levels = NMM_PER_NM * measurement.motion.levels
    return np.unique(np.argmin(np.abs(torque[:, None] - levels), axis=0))


def _states(measurement: Measurement) -> tuple[list[Real], list[Conditions]]:
    """State of every cell of each position, and the conditions of each state.

    A record of a turning crank has a state for each cycle. In loops wear and temperature go on within a cycle, and
    cells lie on lines between states.
    """
    cells, environment = measurement.cells, measurement.unit.settings.environment
    is_turning, states, conditions = isinstance(measurement, TurningMeasurement), [], []
    for position in range(len(measurement.rows.cranks)):
        of_position = cells.position == position
        if is_turning:
            cycles = np.unique(cells.cycle)
            states.append(np.searchsorted(cycles, cells.cycle[of_position]))
            rise = _rise(cells, cycles, environment.temperature_C)
            conditions.append(Conditions((cycles - cycles[0]).astype(float), rise))
            continue
        travelled = _cycles_travelled(measurement, position)
        rise = cells.temperature_mean[of_position] - environment.temperature_C
        known = np.flatnonzero(np.isfinite(rise))
        rise = np.interp(np.arange(len(rise)), known, rise[known]) if known.size else np.zeros(len(rise))
        state, of_states = _piecewise_linear(np.column_stack([travelled, rise]))
        states.append(state)
        conditions.append(Conditions(*of_states))
    return states, conditions


def _cycles_travelled(measurement: Measurement, position: int) -> Real:
    """Way of the torque (n_cells,) from the start of a position to each of its cells, over the usual one of a cycle."""
    cells, turns = measurement.cells, measurement.history.torque[position]
    of_position = cells.position == position
    leg = measurement.history.leg[cells.block[of_position]]
    travel = np.append(0.0, np.cumsum(np.abs(np.diff(turns))))
    cycles = measurement.branches.cycle[measurement.branches.position == position]
    here = travel[leg] + np.abs(cells.torque_mean[of_position] - turns[leg])
    return np.asarray(here * len(np.unique(cycles)) / travel[-1])


def _piecewise_linear(conditions: Real) -> tuple[Real, Real]:
    """Conditions over the cells, travelled cycles and temperature (n_cells, 2), as lines between a few states.

    States are added at the cell that lies farthest from the lines until all lie within a tolerance (Douglas and
    Peucker, Cartographica 10 (1973) 112).

    Returns
    -------
    State of each cell (n_cells,), a fraction between two states, and the conditions of the states (2, n_states), by
    least squares over the cells.
    """
    if not len(conditions):
        return np.zeros(0), np.zeros((2, 1))
    travelled, rise = conditions.T
    noise = SURE * float(np.median(np.abs(np.diff(rise)))) if len(rise) > 1 else 0.0
    tolerance = max(STRAIGHT * float(np.ptp(rise)), noise, 1e-9)
    curves = np.column_stack([np.log1p(travelled) / STRAIGHT, rise / tolerance])
    place = np.maximum.accumulate(travelled) + 1e-9 * np.arange(len(curves))
    chosen = sorted({0, len(curves) - 1})
    while True:
        lines = np.column_stack([np.interp(place, place[chosen], curve[chosen]) for curve in curves.T])
        distance = np.max(np.abs(curves - lines), axis=1)
        if np.max(distance) <= 1:
            break
        chosen = sorted({*chosen, int(np.argmax(distance))})
    state = np.interp(place, place[chosen], np.arange(len(chosen)))
    weights = np.maximum(1 - np.abs(state[:, None] - np.arange(len(chosen))), 0.0)
    return state, np.linalg.lstsq(weights, conditions, rcond=None)[0].T


def _rise(cells: Cells, cycles: Whole, drawing_C: float) -> Real:
    """Temperature over that of the drawing (n_cycles,) [K], mean of each cycle; 0 where it was not measured."""
    rise = np.zeros(len(cycles))
    for number, cycle in enumerate(cycles):
        temperature = cells.temperature_mean[cells.cycle == cycle]
        if np.any(np.isfinite(temperature)):
            rise[number] = np.nanmean(temperature) - drawing_C
    return rise


def _reach(courses: Sequence[Course], training_positions: Whole) -> float:
    """Largest torque [N m] that the curves are solved for: that of trained positions, unless others go far beyond."""
    tops = np.array([np.max(np.abs(course.torque)) for course in courses])
    top = float(np.max(tops[training_positions]))
    return top if np.max(tops) <= BEYOND * top else float(np.max(tops))


def _course(
    measurement: Measurement, states: Sequence[Real], stations: Stations, position: int, visible: Truth
) -> Course:
    unit, cells, turns = measurement.unit, measurement.cells, measurement.history
    of_position = cells.position == position
    crank, lobes = np.radians(measurement.drive_cranks[position]), unit.study.design.cycloid.lobes
    has_times = bool(np.all(np.isfinite(cells.time_mean)))
    begin = np.min(cells.time_mean[visible]) if has_times else 0.0
    time = cells.time_mean[of_position] - begin if has_times else np.zeros(int(of_position.sum()))
    torques, angles, edge_times = rows_within(measurement, np.flatnonzero(of_position))
    of_rows = readings(measurement, position) if has_times else None
    at_input = unit.settings.locked == "output"
    return Course(
        torque=turns.torque[position],
        leg=turns.leg[cells.block[of_position]],
        state=states[position],
        cell_torques=within_cells(measurement, np.flatnonzero(of_position)),
        rows=(torques, angles),
        readings=None if of_rows is None else (of_rows[0] - begin, of_rows[1]),
        edge_times=edge_times - begin if has_times else None,
        is_output_locked=at_input,
        time=time,
        encoder_turns=float(lobes) if at_input else 1.0,
        encoder_place=float(crank if at_input else -crank / lobes),
        sliding=cells.direction[of_position] if isinstance(measurement, TurningMeasurement) else None,
        crank=_crank_motion(measurement, stations, position),
    )


def _crank_motion(measurement: Measurement, stations: Stations, position: int) -> CrankMotion | None:
    """How the crank turns within the loops of a position; None where it is held."""
    settings = measurement.unit.settings.crank
    if settings.moves == "fixed":
        return None
    numbers = stations.of_position[position]
    return CrankMotion(
        stations=np.radians(stations.cranks[numbers.start : numbers.stop]),
        ratio=float(settings.ratio or 0.0),
        cells=stations.measured_crank[measurement.cells.position == position],
        at_input=settings.torque_at == "input",
    )


def _indistinguishable_errors(population: SampledErrors, case: Case | None, measured_to_um: float) -> Errors:
    """Units (POPULATION) that measuring the dimensions of a case cannot tell from these [um]; without a case these.

    A measured dimension has an error that all its elements share, and one of each element alone, each of this size; a
    run-out or position has them in each of two directions. One that was not measured has its tolerance alone.
    """
    if case is None:
        return assembly.errors(population)
    rng = np.random.default_rng(POPULATION)

    def spread(values: Real, size: float) -> Real:
        common = size * rng.standard_normal((POPULATION,) + (1,) * (values.ndim - 1))
        return values + common + (size * rng.standard_normal((POPULATION, *values.shape[1:])) * (values.ndim > 1))

    in_model = {field.name for field in fields(Errors)}
    measured_names = {*case.model_fields_set, *("lobe" for name in LOBE_PROFILES if name in case.model_fields_set)}
    values_of = dict(vars(population))
    for name, dimension in dimension_library().items():
        if name not in measured_names or name in in_model or not (dimension.direction or dimension.displaces):
            continue
        if dimension.direction:
            vector = values_of[dimension.field] * np.exp(1j * values_of[dimension.phase])
            vector = spread(vector.real, measured_to_um) + 1j * spread(vector.imag, measured_to_um)
            values_of |= {dimension.field: np.abs(vector), dimension.phase: np.angle(vector)}
        else:
            values_of[dimension.field] = spread(values_of[dimension.field], measured_to_um)
    errors = dict(vars(assembly.errors(SampledErrors(**values_of))))
    errors |= {name: spread(errors[name], MM_PER_UM * measured_to_um) for name in errors if name in measured_names}
    return Errors(**errors)


def _population(study: Study, case: Case | None = None) -> SampledErrors:
    """Errors [um] of units as the study's tolerances make them; with the dimensions that were measured of one."""
    samples = study.samples.model_copy(
        update={"experiment": "monte_carlo", "count": POPULATION, "nominal_first": False}
    )
    drawn_study = study.model_copy(update={"samples": samples, "cases": ()})
    return draw(drawn_study, 0, POPULATION) if case is None else draw_as_measured(drawn_study, case, 0, POPULATION)


def _mean_unit(population: SampledErrors) -> SampledErrors:
    """The mean unit, about which the modes of the tolerances stand: one-sided tolerances move it from the nominal.

    The mean of run-outs and positions is that of their vectors.
    """
    values_of = {name: values.mean(axis=0, keepdims=True) for name, values in vars(population).items()}
    for dimension in dimension_library().values():
        if dimension.direction:
            amplitude, direction = (getattr(population, name) for name in (dimension.field, dimension.phase))
            mean_vector = np.mean(amplitude * np.exp(1j * direction), axis=0, keepdims=True)
            values_of |= {dimension.field: np.abs(mean_vector), dimension.phase: np.angle(mean_vector)}
    return SampledErrors(**values_of)
