"""Manufacturing errors of a study's samples: sample k is the same for any division of the samples."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from pipeline.config.cases import elements
from pipeline.config.design import Design
from pipeline.config.study import Study
from pipeline.config.tolerances import OVALITIES, PIN_TOLERANCES
from pipeline.sampling.correlation import correlated
from pipeline.sampling.designs import uniforms

Real = NDArray[np.float64]

SCALARS = ("eccentricity", "disk_profile", "bearing_clearance", *OVALITIES)
PHASES = tuple(f"{name}_phase" for name in OVALITIES)


@dataclass(frozen=True)
class Errors:
    """Total deviations from the design, allowances included; signs as in the study file.

    Attributes
    ----------
    eccentricity, disk_profile, bearing_clearance : (n_samples,) [um]; the clearance adds to the design's.
    ovality_2_amplitude, ovality_3_amplitude : (n_samples,) [um].
    ovality_2_phase, ovality_3_phase : (n_samples,) [rad], where the pin circle is widest, counterclockwise from the
        crank at 0.
    pin_radial, pin_tangential, pin_radius : (n_samples, n_pins) [um], pins clockwise; radial with the ovalities added.
    lobe_profile : (n_samples, n_lobes) [um], beside disk_profile; lobes clockwise.
    roller_diameter : (n_samples, n_rollers) [um], in the order of the output's contacts.
    """

    eccentricity: Real
    disk_profile: Real
    bearing_clearance: Real
    ovality_2_amplitude: Real
    ovality_2_phase: Real
    ovality_3_amplitude: Real
    ovality_3_phase: Real
    pin_radial: Real
    pin_tangential: Real
    pin_radius: Real
    lobe_profile: Real
    roller_diameter: Real

    def __len__(self) -> int:
        return len(self.eccentricity)


def draw(study: Study, start: int, stop: int) -> Errors:
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
    one tolerance have equal random numbers in all others and can be compared sample by sample.
    """
    if not 0 <= start <= stop <= study.samples.rows:
        raise ValueError(f"samples {start} to {stop} asked of {study.samples.rows}")
    shift = int(study.samples.nominal_first)
    first, last = max(start - shift, 0), max(stop - shift, 0)
    drawn = _listed(study, first, last) if study.samples.experiment == "cases" else _random(study, first, last)
    if shift and start == 0 < stop:
        drawn = _joined(_nominal(study), drawn)
    return drawn


def oval_shift(amplitude: Real, phase: Real, order: int, pins: int) -> Real:
    """Radial shift of the pins by a ring out of round, amplitude cos(order (theta - phase)).

    Parameters
    ----------
    amplitude : (n_samples,), in any unit of length.
    phase : (n_samples,) [rad].
    order : waves around the circle.
    pins : number of pins, clockwise from theta = 0.

    Returns
    -------
    (n_samples, pins), in the unit of the amplitude.
    """
    theta = -2 * np.pi * np.arange(pins) / pins
    return amplitude[:, None] * np.cos(order * (theta - phase[:, None]))


def _random(study: Study, start: int, stop: int) -> Errors:
    return errors_at(study, uniforms(study.samples, sum(dimensions(study.design).values()), start, stop))


def dimensions(design: Design) -> dict[str, int]:
    """Dimensions of the design of experiment that belong to each tolerance and phase, in their order."""
    return {**dict.fromkeys((*SCALARS, *PHASES), 1), **elements(design)}


def errors_at(study: Study, numbers: Real) -> Errors:
    """Errors at points of the unit cube, ``numbers`` (n_samples, n_dimensions)."""
    sizes = dimensions(study.design)
    ends = np.cumsum(list(sizes.values()))
    columns = dict(zip(sizes, np.split(numbers, ends[:-1], axis=1), strict=True))
    values = {name: 2 * np.pi * columns.pop(name) for name in PHASES}
    for name, probability in columns.items():
        tolerance = getattr(study.tolerances, name)
        length = getattr(tolerance, "correlation_length_mm", None)
        if length is not None:
            probability = correlated(probability, _circumference(name, study.design), length)
        values[name] = tolerance.allowance_um + tolerance.deviation(probability)
    return _errors(values, study.design)


def _circumference(name: str, design: Design) -> float:
    """Length of the circle on which the elements lie [mm]: the pin circle, or the disk at half the lobes' height."""
    radius = design.cycloid.pin_circle_radius_mm
    return 2 * np.pi * (radius if name in PIN_TOLERANCES else radius - design.cycloid.pin_radius_mm)


def _listed(study: Study, start: int, stop: int) -> Errors:
    listed = study.cases[start:stop]
    counts = {**dict.fromkeys(SCALARS, 1), **elements(study.design)}
    values = {
        name: np.array([np.broadcast_to(getattr(case, name), n) for case in listed]).reshape(-1, n)
        for name, n in counts.items()
    }
    return _errors({**values, **dict.fromkeys(PHASES, np.zeros((len(listed), 1)))}, study.design)


def _nominal(study: Study) -> Errors:
    """The allowances without deviations, one sample."""
    counts = {**dict.fromkeys(SCALARS, 1), **elements(study.design)}
    values = {name: np.full((1, n), getattr(study.tolerances, name).allowance_um) for name, n in counts.items()}
    return _errors({**values, **dict.fromkeys(PHASES, np.zeros((1, 1)))}, study.design)


def _errors(values: dict[str, Real], design: Design) -> Errors:
    """Errors from one array (n_samples, n_elements) per tolerance and phase."""
    single = {name: values[name][:, 0] for name in (*SCALARS, *PHASES)}
    radial = values["pin_radial"].copy()
    for name, order in OVALITIES.items():
        radial += oval_shift(single[name], single[f"{name}_phase"], order, design.cycloid.pins)
        single[f"{name}_amplitude"] = single.pop(name)
    return Errors(**single, **{name: values[name] for name in elements(design)} | {"pin_radial": radial})


def _joined(*parts: Errors) -> Errors:
    return Errors(**{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Errors)})
