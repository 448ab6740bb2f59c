"""What the written study says of the load history that was measured: its files, held against the data."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline import assembly
from pipeline.arrays import Real
from pipeline.config import load_study
from pipeline.identification.bench.instrument_effects import InstrumentEffect
from pipeline.identification.bench.load_path import Instrument
from pipeline.identification.fitting.data import Data
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import Fit
from pipeline.identification.fitting.problem import Model
from pipeline.identification.fitting.scaled_drives import softness
from pipeline.identification.fitting.stations import stations_of
from pipeline.identification.identify import Identification
from pipeline.mounting import drive_of
from pipeline.sampling import draw


@dataclass(frozen=True)
class WrittenStudy:
    """A written study beside the measurement.

    Attributes
    ----------
    study : name of its file.
    angle : (n_cells,) [arcmin] of the unit as measured, else of the nominal one, on the measured torques, with
        the offset of each position.
    rms_arcmin : of what it leaves, each cell counted by its rows.
    fit_rms_arcmin, declared_rms_arcmin : of the fit that it was written from, and of the model as declared.
    """

    study: str
    angle: Real
    rms_arcmin: float
    fit_rms_arcmin: float
    declared_rms_arcmin: float


def written_study(identification: Identification, path: Path, fit: Fit) -> WrittenStudy:
    """The study of a file, with its design, on the load history of the unit.

    Parameters
    ----------
    fit : that it was written from.

    Notes
    -----
    Of the fit only the errors of the bench are taken, which are none of the reducer: numbers, effects, dimensions and
    factors of the force laws are those of the files, run in. The disk is the one that was condensed, softer or stiffer
    by modulus and thickness.

    Raises
    ------
    InputError : as ``load_study``.
    """
    study, problem = load_study(path, path.parent), identification.problem
    unit = int(bool(study.cases) and study.samples.nominal_first)  # the unit as measured, else the nominal one
    sample = draw(study, unit, unit + 1)
    factor = softness(study.design) / softness(identification.measurement.unit.study.design)
    clearance = assembly.bearing_clearance(study.design, sample.bearing_clearance)
    angle = np.full(len(problem.data), np.nan)
    bench = Instrument()
    for effect, values in fit.model.split(fit.values.tolist()):
        bench = effect.apply(bench, values) if isinstance(effect, InstrumentEffect) else bench
    cranks = stations_of(identification.measurement).cranks
    for position, stations in enumerate(problem.stations):
        drives = tuple(
            drive_of(study, float(cranks[k]), factor * problem.compliances[k], assembly.errors(sample), clearance)
            for k in stations
        )
        angle[problem.data.position == position] = problem.forward.read(drives, position, bench).angle
    fitter = Fitter(problem)
    declared_angle = fitter.predict(Model(), fitter.start(Model())).angle
    curves = [
        curve + fitter.offsets(curve, np.ones(len(angle), bool), problem.data.sigma)
        for curve in (angle, declared_angle)
    ]
    errors = [_rms(problem.data, curve) for curve in (curves[0], fit.predicted_angle, curves[1])]
    return WrittenStudy(path.name, curves[0], *errors)


def _rms(data: Data, angle: Real) -> float:
    """Root mean square [arcmin] of what a prediction (n_cells,) leaves, each cell counted by its rows."""
    return float(np.sqrt(np.average((data.angle - angle) ** 2, weights=data.count)))
