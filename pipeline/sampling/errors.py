"""Manufacturing errors of a study's samples: sample k is the same for any division of the samples."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, make_dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from pipeline.arrays import Real
from pipeline.config.designs.design import Design
from pipeline.config.dimensions import Dimension, dimension_library
from pipeline.config.distributions import Spread
from pipeline.config.studies.study import Samples
from pipeline.config.studies.tolerances import Case, Tolerances
from pipeline.sampling.designs import correlated_numbers, uniforms


@dataclass(frozen=True)
class _Errors:
    """Total deviations from the design, allowances included; signs are those of the dimensions.

    Attributes
    ----------
    eccentricity, disk_profile, bearing_clearance, eccentric_phase : (n_samples,), of several disks (n_samples, n_disks)
        [um]; the clearance adds to the design's.
    pin_radial, pin_tangential, pin_radius : (n_samples, n_pins) [um], pins clockwise; radial with the ovalities added.
    lobe_profile : (n_samples, n_disks n_lobes) [um], beside disk_profile; lobes clockwise, disk after disk.
    lobe_pitch : (n_samples, n_disks n_lobes) [um], in the same order.
    bore_runout_amplitude, bore_runout_phase : as eccentricity [um] and [rad], counterclockwise in the disk's frame.
    roller_diameter : (n_samples, n_rollers) [um], in the order of the output's contacts; with bushes, less what their
        bores are larger, and more by what the pins under them are thicker.
    hole_diameter : (n_samples, n_disks n_holes) [um], in the order of output pins or cranks, disk after disk; with the
        clearances of the cranks' bearings.
    output_pin_position_amplitude, output_pin_position_phase : (n_samples, n_output_contacts) [um] and [rad].
    hole_position_amplitude, hole_position_phase : (n_samples, n_disks n_holes) [um] and [rad].
    pin_roundness_2_amplitude, pin_roundness_2_phase : (n_samples, n_pins) [um] and [rad]; as well of order 3.
    disk_growth, pins_growth, housing_growth, crank_growth : (n_samples,) [um] by drawn temperatures; what they change
        of pins and eccentricity is counted there.

    Every other dimension has an attribute of its name, (n_samples,) or (n_samples, n_elements) [um]. One with a
    direction has ``<name>_amplitude`` [um] and ``<name>_phase`` [rad], counterclockwise from the crank at 0: of an
    ovality where the pin circle is widest.
    """

    eccentricity: Real
    disk_profile: Real
    bearing_clearance: Real
    pin_radial: Real
    pin_tangential: Real
    pin_radius: Real
    lobe_profile: Real
    roller_diameter: Real
    eccentric_phase: Real
    lobe_pitch: Real
    bore_runout_amplitude: Real
    bore_runout_phase: Real
    output_pin_position_amplitude: Real
    output_pin_position_phase: Real
    hole_position_amplitude: Real
    hole_position_phase: Real
    hole_diameter: Real
    pin_roundness_2_amplitude: Real
    pin_roundness_2_phase: Real
    pin_roundness_3_amplitude: Real
    pin_roundness_3_phase: Real
    disk_growth: Real
    pins_growth: Real
    housing_growth: Real
    crank_growth: Real
    planet_backlash: Real

    def __len__(self) -> int:
        return len(self.eccentricity)


if TYPE_CHECKING:
    Errors = _Errors
else:
    _names = [n for d in dimension_library().values() for n in ((d.field, d.phase) if d.direction else (d.field,))]
    for _dimension in dimension_library().values():
        if not (_dimension.shift or _dimension.displaces or _dimension.field in _Errors.__dataclass_fields__):
            raise TypeError(f"dimension {_dimension.name} acts on nothing; give it a shift, or a gap in the model")
    _fields = [(name, Real) for name in _names if name not in _Errors.__dataclass_fields__]
    Errors = make_dataclass("Errors", _fields, bases=(_Errors,), frozen=True, namespace={"__module__": __name__})


class Drawn(Protocol):
    """What of a study its draws depend on."""

    @property
    def samples(self) -> Samples: ...
    @property
    def tolerances(self) -> Tolerances: ...
    @property
    def design(self) -> Design: ...
    @property
    def cases(self) -> Sequence[Case]: ...


def draw(study: Drawn, start: int, stop: int) -> Errors:
    """Errors of the samples [start, stop); sample 0 is the nominal reducer where the study says so.

    Parameters
    ----------
    study : its samples, tolerances or cases, and design.
    start, stop : first sample, and the one after the last.

    Raises
    ------
    ValueError : the study has no such samples.

    Notes
    -----
    Each error has its own dimension of the design of experiment, whether it varies or not: two studies that differ in
    one tolerance have equal random numbers in all others and can be compared sample by sample. Excepted are those
    counted where they vary.
    """
    if not 0 <= start <= stop <= study.samples.rows:
        raise ValueError(f"samples {start} to {stop} asked of {study.samples.rows}")
    shift = int(study.samples.nominal_first)
    first_row, last_row = max(start - shift, 0), max(stop - shift, 0)
    draw_rows = _listed_errors if study.samples.experiment == "cases" else _random
    drawn_errors = draw_rows(study, first_row, last_row)
    if shift and start == 0 < stop:
        drawn_errors = joined_errors(_nominal(study), drawn_errors)
    return drawn_errors


def draw_as_measured(study: Drawn, case: Case, start: int, stop: int) -> Errors:
    """Errors of samples that have the deviations which a case states, and all others as the tolerances make them.

    What acts through a stated dimension, as an ovality through the pins' places, was measured with it.

    Parameters
    ----------
    study : as for `draw`, of samples that are drawn.
    case : a dimension that it does not name was not measured.
    start, stop : first sample, and the one after the last.
    """
    counts = _counts(study.design)
    values = deviations_at(study, uniforms(study.samples, sum(dimensions(study).values()), start, stop))
    for name, dimension in dimension_library().items():
        if _was_measured(case, dimension):
            values[name] = np.broadcast_to(case.deviation_um(name), (stop - start, counts[name]))
            if dimension.direction:
                values[dimension.phase] = np.broadcast_to(
                    case.direction_rad(name), (stop - start, counts[dimension.phase])
                )
    return _errors(values, study.design)


def draw_with_parts(study: Drawn, measured_values: Mapping[str, Real], start: int, stop: int) -> Errors:
    """Errors of samples whose measured dimensions differ from sample to sample, and all others as the tolerances say.

    What acts through a measured dimension, as an ovality through the pins' places, was measured with it. Directions
    that were not measured are drawn.

    Parameters
    ----------
    study : as for `draw`, of samples that are drawn.
    measured_values : total deviations by dimension (stop - start, n_elements) [um], and measured directions [rad] by
        ``<dimension>_phase``; one column for equal elements.
    start, stop : first sample, and the one after the last.
    """
    counts, library = _counts(study.design), dimension_library()
    drawn_directions = {
        library[name].phase: _random_directions(study, library[name], counts[name], stop)[start:]
        for name in measured_values.keys() & library.keys()
        if library[name].direction and library[name].phase not in measured_values and not varies(study, name)
    }
    numbers = uniforms(study.samples, sum(dimensions(study).values()), start, stop)
    return errors_with_parts(study, {**measured_values, **drawn_directions}, numbers)


def _random_directions(study: Drawn, dimension: Dimension, count: int, stop: int) -> Real:
    """Directions (stop, count) [rad] of a measured amplitude that does not vary in the study, by its seed."""
    rng = np.random.default_rng([study.samples.seed, *dimension.draw_columns])
    return rng.uniform(0.0, 2 * np.pi, (stop, count))


def errors_with_parts(study: Drawn, measured_values: Mapping[str, Real], numbers: Real) -> Errors:
    """As `draw_with_parts`, the other dimensions at points of the unit cube, ``numbers`` (n_samples, n_dimensions)."""
    counts = _counts(study.design)
    values = deviations_at(study, numbers)
    for name, dimension in dimension_library().items():
        if name in measured_values:
            values[name] = np.broadcast_to(measured_values[name], (len(numbers), counts[name]))
        elif dimension.acts_on in measured_values:
            values[name] = np.zeros((len(numbers), counts[name]))
        if dimension.phase in measured_values:
            values[dimension.phase] = np.broadcast_to(measured_values[dimension.phase], (len(numbers), counts[name]))
    return _errors(values, study.design)


def usual_beside(study: Drawn, case: Case) -> Case:
    """The case with the mean of its tolerance [um] for each dimension that was not measured; none of a direction."""
    means = {}
    for name, dimension in dimension_library().items():
        tolerance = getattr(study.tolerances, name)
        if not dimension.direction and not _was_measured(case, dimension):
            means[name] = tolerance.allowance_um + tolerance.average_um
    return case.model_copy(update={name: mean for name, mean in means.items() if mean})


def unmeasured_dimensions(study: Drawn, case: Case) -> tuple[str, ...]:
    """Names of the dimensions that vary from unit to unit in a study and that a case does not state."""
    library = dimension_library().items()
    return tuple(name for name, dimension in library if varies(study, name) and not _was_measured(case, dimension))


def _was_measured(case: Case, dimension: Dimension) -> bool:
    """Whether a case states a dimension, or one that it acts through."""
    return bool({dimension.name, dimension.acts_on} & case.model_fields_set)


def _random(study: Drawn, start: int, stop: int) -> Errors:
    return errors_at(study, uniforms(study.samples, sum(dimensions(study).values()), start, stop))


def varies(study: Drawn, name: str) -> bool:
    """Whether a tolerance varies from unit to unit; an ovality of fixed amplitude varies by its phase."""
    tolerance = getattr(study.tolerances, name)
    has_direction = bool(dimension_library()[name].direction)
    return tolerance.varies or (has_direction and tolerance.allowance_um + tolerance.limits_um[0] > 0)


def dimensions(study: Drawn) -> dict[str, int]:
    """Dimensions of the design of experiment that belong to each tolerance and phase, in their order."""
    library = dimension_library().values()
    constant_dimensions = [d for d in library if d.counted_where_varied and not varies(study, d.name)]
    names = {name for dimension in constant_dimensions for name in (dimension.name, dimension.phase)}
    return {name: count for name, count in _counts(study.design).items() if name not in names}


def _counts(design: Design) -> dict[str, int]:
    """Deviations and phases of a reducer by name, in the order of the design of experiment."""
    places: list[tuple[int, str, int]] = []
    for name, dimension in dimension_library().items():
        places.append((dimension.draw_columns[0], name, dimension.count(design)))
        if dimension.direction:
            places.append((dimension.draw_columns[1], dimension.phase, dimension.count(design)))
    return {name: count for _, name, count in sorted(places)}


def _directions() -> list[str]:
    return [dimension.phase for dimension in dimension_library().values() if dimension.direction]


def errors_at(study: Drawn, numbers: Real) -> Errors:
    """Errors at points of the unit cube, ``numbers`` (n_samples, n_dimensions)."""
    return _errors(deviations_at(study, numbers), study.design)


def deviations_at(study: Drawn, numbers: Real) -> dict[str, Real]:
    """Deviations [um] and directions [rad] (n_samples, n_elements) of each tolerance at points of the unit cube."""
    sizes = dimensions(study)
    ends = np.cumsum(list(sizes.values()))
    midpoints = {name: np.full((len(numbers), count), 0.5) for name, count in _counts(study.design).items()}
    columns = midpoints | dict(zip(sizes, np.split(numbers, ends[:-1], axis=1), strict=True))
    values = {name: 2 * np.pi * columns.pop(name) for name in _directions()}
    for name, probability in columns.items():
        tolerance = getattr(study.tolerances, name)
        if isinstance(tolerance, Spread):
            probability = _correlated_numbers(name, probability, study.design, tolerance)
        values[name] = tolerance.allowance_um + tolerance.deviation(probability)
    return values


def _correlated_numbers(name: str, probability: Real, design: Design, tolerance: Spread) -> Real:
    """The uniform numbers (n_samples, n_elements), correlated as a tolerance says among the elements of each disk."""
    length, share = tolerance.correlation_length_mm, tolerance.common_share
    if length is None and share is None:
        return probability
    elements = dimension_library()[name].elements
    if elements is None or (length is not None and elements.radius_mm is None):
        raise ValueError(f"{name} does not lie along a circle")
    circles = probability.reshape(-1, elements.count(design))
    circumference = 2 * np.pi * elements.radius_mm(design) if elements.radius_mm else 0.0
    return correlated_numbers(circles, circumference, length, share or 0.0).reshape(probability.shape)


def _listed_errors(study: Drawn, start: int, stop: int) -> Errors:
    cases, counts = study.cases[start:stop], _counts(study.design)
    values = {
        name: np.array([np.broadcast_to(case.deviation_um(name), n) for case in cases]).reshape(len(cases), n)
        for name, n in counts.items()
        if name in dimension_library()
    }
    directions = {
        dimension.phase: np.array([np.broadcast_to(case.direction_rad(name), counts[name]) for case in cases])
        for name, dimension in dimension_library().items()
        if dimension.direction
    }
    in_rows = {name: rows.reshape(len(cases), counts[name]) for name, rows in directions.items()}
    return _errors({**values, **in_rows}, study.design)


def _nominal(study: Drawn) -> Errors:
    """The allowances without deviations, one sample."""
    counts = _counts(study.design)
    values = {name: np.full((1, counts[name]), tolerance.allowance_um) for name, tolerance in study.tolerances}
    return _errors({**values, **{name: np.zeros((1, counts[name])) for name in _directions()}}, study.design)


def _errors(values: dict[str, Real], design: Design) -> Errors:
    """Errors from one array (n_samples, n_elements) per tolerance and phase."""
    library = dimension_library().values()
    disks = design.disk.count
    errors = {}
    for dimension in library:
        names = {dimension.field: dimension.name} | ({dimension.phase: dimension.phase} if dimension.direction else {})
        for field, name in names.items():
            if dimension.elements:
                size = dimension.elements.count(design) * (disks if dimension.of_disk else 1)
                errors[field] = values[name] if values[name].shape[1] else np.zeros((len(values[name]), size))
            else:
                errors[field] = _per_disk(values[name], disks if dimension.of_disk else 1)
    for dimension in library:
        if dimension.shift:
            deviation = errors[dimension.field]
            direction = errors.get(dimension.phase, np.zeros(len(deviation)))
            errors[dimension.acts_on] = errors[dimension.acts_on] + dimension.shift(deviation, direction, design)
    if design.thermal is not None:
        growth_um = {part: errors[f"{part}_growth"] for part in design.thermal.drawn_parts}
        for name, shift in design.thermal.shifts_um(growth_um).items():
            errors[name] = errors[name] + np.reshape(shift, (-1,) + (1,) * (errors[name].ndim - 1))
    return Errors(**errors)


def _per_disk(values: Real, disks: int) -> Real:
    """Values (n_samples,) of what a reducer has once, (n_samples, disks) of what each disk has; zero where none can."""
    values = values if values.shape[1] else np.zeros((len(values), disks))
    return values if disks > 1 else values[:, 0]


def joined_errors(*parts: Errors) -> Errors:
    """Errors of samples of several parts, one part after the other."""
    return Errors(**{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Errors)})
