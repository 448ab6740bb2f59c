"""Sizes that would be noticed and named, against the whole decision on a unit that the effect is put into.

``tests/identification/selection/test_detection.py`` is the short form, on linear units.
"""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.identification import identify as decision
from pipeline.identification.fitting.build import build_problem
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import shares_of_values
from pipeline.identification.fitting.problem import Model
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.identification.selection.criteria import LARGEST_CLASS
from pipeline.identification.selection.model_selection import Selector
from pipeline.identification.selection.statements.detection import detection_limits
from tests.validation.blind.catalogue import no_compliance
from tests.validation.blind.command_line import designs
from tests.validation.blind.compliant_drive.unit import drawn_unit
from tests.validation.blind.rates import lower_bound

ROOT = Path(__file__).parents[2]
SEED, CASE = 26043, 0
"""A unit without an effect of the third simulator; the seed is for tuning."""
EFFECTS = ("coulomb", "bearing_clearance", "torque_zero", "flank_wear")
REPLICATES = int(os.environ.get("INJECTION_REPLICATES", "200"))


class Injection:
    """A unit without an effect, its limits, and what the decision says of replicates of it with an effect."""

    def __init__(self, folder):
        measurement = Measurement.read(load_measured_unit(folder, ROOT))
        self.measurement = measurement
        compliances = no_compliance(measurement.unit.study, measurement.rows.cranks.tolist())
        self.problem = build_problem(measurement, compliances)
        self.cells = np.ones(len(self.problem.data), bool)
        fitter, selector = Fitter(self.problem), Selector(Fitter(self.problem), self.cells)
        self.base = selector.select(self.cells).base
        self.testable = selector.testable
        self.limits = {limit.effect: limit for limit in detection_limits(fitter, self.base, self.testable)}

    def decided(self, angle):
        """Selection of a replicate whose cells have other angles (n_cells,), in its training cells too."""

        def with_angle(problem):
            return replace(
                problem,
                data=replace(problem.data, angle=angle),
                trained_on=lambda training: with_angle(self.problem.trained_on(training)),
            )

        selector = Selector(Fitter(with_angle(self.problem)), self.cells)
        baselines = decision._baseline_curves(self.measurement, selector.fitter, self.cells)
        return decision._tested_on_unused_data(selector, selector.select(self.cells), self.cells, baselines)[0]

    def replicate(self, effect, size, rng):
        """Angle of the unit with an effect of a size; its residual drawn branch by branch.

        The cycles of a branch change places, of equal length or cut, and all change their sign together: what they have
        in common does not differ between cycles in a replicate either, as it would if each were drawn by itself.
        """
        data, fit = self.problem.data, self.base.fit
        residual = data.angle - fit.predicted_angle
        drawn_residual = np.empty_like(residual)
        for branch in np.unique(data.branch):
            numbers, sense = np.unique(data.block[data.branch == branch]), rng.choice([-1.0, 1.0])
            for number, drawn_number in zip(numbers, rng.permutation(numbers), strict=True):
                cells = data.block == number
                drawn_residual[cells] = sense * np.resize(residual[data.block == drawn_number], np.sum(cells))
        bounds = self.problem.bounds(self.testable[effect])
        unknowns = replace(fit.unknowns, shares=shares_of_values(bounds, [size]))
        changed_angle = Fitter(self.problem).predict(Model((self.testable[effect],)), unknowns).angle
        plain_angle = Fitter(self.problem).predict(Model(), fit.unknowns).angle
        return fit.predicted_angle + changed_angle - plain_angle + drawn_residual


def counts(injection, effect, replicates, seed=26043):
    """How often the sizes that would be noticed and named are, of so many replicates each."""
    rng, limit = np.random.default_rng([seed, EFFECTS.index(effect)]), injection.limits[effect]
    noticed = named = 0
    for _ in range(replicates):
        noticed += bool(injection.decided(injection.replicate(effect, limit.noticed, rng)).best_model)
        members = injection.decided(injection.replicate(effect, limit.named, rng)).members
        named += any(effect in name.split("+") for name in members) and len(members) <= LARGEST_CLASS
        print(f"{effect}: noticed {noticed}, named {named}", flush=True)
    return noticed, named


@pytest.mark.attack
@pytest.mark.parametrize("effect", EFFECTS)
def test_95_percent_means_90_to_98(effect, tmp_path):
    drawn_unit(SEED, CASE, designs(ROOT)).write(tmp_path / "unit")
    injection = Injection(tmp_path / "unit")
    if effect not in injection.limits or np.isnan(injection.limits[effect].named):
        pytest.skip("no size of it would be named")
    for count in counts(injection, effect, REPLICATES):
        low, high = lower_bound(count, REPLICATES), 1 - lower_bound(REPLICATES - count, REPLICATES)
        print(f"{effect}: {count} of {REPLICATES}, {low:.2f} to {high:.2f}", flush=True)
        assert low <= 0.98
        assert high >= 0.90
