"""What the written study says of the load history that was measured: its files, held against the data."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline import assembly
from pipeline.config import load_study
from pipeline.identification.bench.simulator import Instrument
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.scaled_drives import softness
from pipeline.identification.identify import Identification
from pipeline.mounting import drive_of
from pipeline.sampling import draw

Real = NDArray[np.float64]


@dataclass(frozen=True)
class WrittenStudy:
    """A written study beside the measurement.

    Attributes
    ----------
    study : name of its file.
    angle : (n_cells,) [arcmin] of the unit as measured, else of the nominal one, on the measured torques, with
        the offset of each position.
    rms_arcmin : of what it leaves, each cell counted by its rows.
    """

    study: str
    angle: Real
    rms_arcmin: float


def written_study(identification: Identification, path: Path) -> WrittenStudy:
    """The study of a file, with its design, on the load history of the unit.

    Nothing is taken from the fits: numbers, effects and tolerances are those of the files, run in and at the
    temperature of the drawing. Instrument, time and the fitted factors of the force laws are not in them. The disk is
    the one that was condensed, softer or stiffer by modulus and thickness.

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
    for position, compliance in enumerate(problem.compliances):
        crank = float(identification.measurement.drive_cranks[position])
        drive = drive_of(study, crank, factor * compliance, assembly.errors(sample), clearance)
        angle[problem.data.position == position] = problem.forward.read(drive, position, Instrument()).angle
    angle += Fitter(problem).offsets(angle, np.ones(len(angle), bool), problem.data.sigma)
    square = (problem.data.angle - angle) ** 2
    return WrittenStudy(path.name, angle, float(np.sqrt(np.average(square, weights=problem.data.count))))
