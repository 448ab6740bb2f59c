"""The problem of a measured unit with as many condensed crank angles as its data need."""

from collections.abc import Callable, Sequence

import numpy as np

from pipeline.arrays import Real, Truth
from pipeline.config.studies.study import Study
from pipeline.constant_kinds import Fineness, Rounding
from pipeline.identification.fitting.build import build_problem
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import Vector, values_at_shares
from pipeline.identification.fitting.problem import Model, Problem, first_states
from pipeline.identification.fitting.scaled_drives import drives_of
from pipeline.identification.fitting.stations import stations_of
from pipeline.identification.measurement.measurement import Measurement

Condensed = Callable[[Study, Sequence[float]], Sequence[Real]]
"""Compliances of a study's design at crank angles [deg]: each (n_contacts, n_contacts) [mm/N]."""

LARGEST_ERROR: Rounding = 0.5
"""Error of the angle between two stations, in noise of a cell, beyond which the distance between them is halved."""
MOST_HALVINGS: Fineness = 2
"""Halvings at most: twelve stations while the crank turns from one pin to the next."""


def condensed_problem(measurement: Measurement, condense: Condensed, visible: Truth | None = None) -> Problem:
    """The problem of a measured unit, with stations so close that the declared drive is known between them.

    The distance is halved ``MOST_HALVINGS`` times at most. ``error_between_cranks`` says what is then left.

    Parameters
    ----------
    visible : (n_cells,) training cells, all by default; see ``build_problem``.
    """
    halvings = 0
    while True:
        compliances = condense(measurement.unit.study, stations_of(measurement, halvings).cranks.tolist())
        problem = build_problem(measurement, compliances, visible, halvings)
        fitter = Fitter(problem)
        error = error_between_cranks(measurement, condense, fitter, Model(), fitter.start(Model()))
        if error is None or error <= LARGEST_ERROR * problem.data.noise or halvings == MOST_HALVINGS:
            return problem
        halvings += 1


def error_between_cranks(
    measurement: Measurement, condense: Condensed, fitter: Fitter, model: Model, unknowns: Vector
) -> float | None:
    """Largest error [arcmin] of a model halfway between two stations, by drives made there.

    None where the crank is held.
    """
    problem, study, forward = fitter.problem, measurement.unit.study, fitter.forward(model)
    if not any(course.crank for course in forward.courses):
        return None
    stations = stations_of(measurement, problem.halvings + 1)
    conditions = [problem.conditions[problem.stations[p][0]] for p, of in enumerate(stations.of_position) for _ in of]
    compliances = condense(study, stations.cranks.tolist())
    drive_at = drives_of(study, problem.calibrated_keys, problem.mean_unit, stations.cranks, compliances, conditions)
    scales, deviations = tuple(np.exp(unknowns.scales)), vars(problem.modes_of_errors(unknowns.modes))
    drives = [drive_at(scales, k).with_added_errors(**deviations) for k in range(len(conditions))]
    values = values_at_shares(fitter.bounds(model), unknowns.shares).tolist()
    put, _ = model.put(drives if model.by_state else first_states(drives), conditions, values)
    cranks = np.radians(stations.cranks)
    of_positions = (slice(numbers.start, numbers.stop) for numbers in stations.of_position)
    return max(
        forward.interpolation_error(tuple(put[numbers]), position, cranks[numbers])
        for position, numbers in enumerate(of_positions)
    )
