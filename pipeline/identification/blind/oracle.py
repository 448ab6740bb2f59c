"""What could be told apart at all: effects fitted with the generator's own model, all else known, to curves without
noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.config.cases import Case
from pipeline.config.study import Study
from pipeline.identification.blind.designs import Condensed
from pipeline.identification.blind.files import DIMENSIONS
from pipeline.identification.blind.generate import OUTSIDE_KIND, Made
from pipeline.identification.blind.sizes import problem_of
from pipeline.identification.fitting import Fitter, unmapped
from pipeline.identification.problem import Model, candidates
from pipeline.identification.selection import NESTED, Selector
from pipeline.identification.unit import load_measured_unit

Real = NDArray[np.float64]

NEAREST = 4
"""Effects that are fitted in full, the best of a look over the grid of their parameters."""
ITERATIONS = 8


def distances(made: Made, folder: Path, root: Path, condensed: Condensed) -> dict[str, float]:
    """Rms distance [noise floors] from the true curves of the nearest effects that are not the true one, by name.

    Parameters
    ----------
    made : a unit with one effect of the library, or one outside it.
    folder : of its files: their rows are the places that are compared.
    condensed : compliances of the generating study.

    Notes
    -----
    Calibrated numbers are refitted beside each effect. An effect that becomes the true one at a limit of its
    parameters is left out: the simpler of the two is named anyway.
    """
    unit = load_measured_unit(folder, root)
    listed = {
        name: tuple(value.tolist()) if np.ndim(value := getattr(made.dimensions, name)[0]) else float(value)
        for name in DIMENSIONS
    }
    known = replace(unit, study=made.unit.study, dimensions=Case(label="true", **listed))
    nominal = made.reducer.truth.design.disk.thickness_mm / made.unit.study.design.disk.thickness_mm

    def softened(study: Study, cranks: Sequence[float]) -> list[Real]:
        return [nominal * matrix for matrix in condensed(study, cranks)]

    problem, over_cells = problem_of(known, softened)
    true = made.truth["truth"]
    fitter = Fitter(problem)
    if made.truth["kind"] == OUTSIDE_KIND:
        curves = over_cells(np.concatenate(made.angles))
    else:
        model = Model((candidates()[true],))
        shares = unmapped(fitter.bounds(model), made.truth["effects"][0]["values"])
        curves = fitter.predict(model, fitter.start(model, shares))[0]
    problem = replace(problem, data=replace(problem.data, angle=curves))
    fitter = Fitter(problem)
    selector, everything = Selector(fitter), np.ones(len(problem.data), bool)
    base = fitter.fit(Model(), everything, fitter.start(Model()))
    screened = selector.screen(everything, base)
    others = [name for name in screened if name != true and NESTED.get(name) != true]
    found = {}
    for name in sorted(others, key=lambda name: screened[name][0])[:NEAREST]:
        start = replace(base.unknowns, shares=np.array(screened[name][1]))
        fit = fitter.fit(Model((selector.testable[name],)), everything, start, ITERATIONS)
        if np.isfinite(fit.cost):
            apart = (curves - fit.predicted) / problem.data.sigma
            found[name] = float(np.sqrt(np.mean(apart**2)))
    return found
