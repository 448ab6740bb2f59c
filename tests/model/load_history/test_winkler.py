"""A loop on independent springs: equal to the equilibria of the same springs, whose solver shares no code with it."""

from dataclasses import replace

import numpy as np
import pytest
from drives import RATED, small_drive

from pipeline.model.contact.laws import ContactLaws
from pipeline.model.geometry.reducer import Bearing
from pipeline.model.load_history.load_cycle import LoadCycle
from pipeline.model.load_history.loop_readings import loop_readings
from pipeline.model.load_history.response import respond
from pipeline.model.load_history.winkler import secant_compliance, winkler_readings
from pipeline.model.metrics import Definitions
from pipeline.model.units import NMM_PER_NM

AT = Definitions(0.03 * RATED / NMM_PER_NM, 0.5 * RATED / NMM_PER_NM, RATED / NMM_PER_NM)


def on_springs(drive, compliance):
    """The drive with linear laws, rigid bodies and a bearing that hardly gives way."""
    zero = np.zeros_like(compliance)
    laws = ContactLaws(compliance, zero, zero, zero + 1, zero + np.inf, drive.laws.pressure)
    return replace(drive, laws=laws, compliance=np.zeros_like(drive.compliance), bearing=Bearing(1e10, 1.0))


@pytest.mark.parametrize("play", [0.004, -0.001])
def test_readings_are_those_of_the_equilibria(play):
    """Every reading of 20 units, with play and preloaded, within what a bearing of 1e10 N/mm gives way."""
    rng = np.random.default_rng(3)
    drive = small_drive(20, play=play)
    compliance = 1e-4 * (0.5 + rng.random(drive.gap.shape[1]))
    springs = on_springs(drive, compliance)
    response = respond(springs, LoadCycle.evenly(RATED, 0, 1.0, (0.03, 0.5, 1.0)))
    assert np.all(response.converged)
    peak = np.max(springs.laws.peak_pressure(response.equilibria.force), axis=(1, 2))
    exact = vars(loop_readings(response, peak, AT))
    for name, values in vars(winkler_readings(springs, compliance, AT)).items():
        if play > 0 or "limit" not in name and "zero" not in name:  # rigid bodies know no limit where all interfere
            np.testing.assert_allclose(values, exact[name], rtol=2e-4, atol=2e-5 * np.max(np.abs(values)))


def test_springs_of_springs_are_themselves():
    """Springs alike within a part, and bodies that are springs too: their sum."""
    drive = small_drive(3)
    part = np.where(drive.reducer.contacts.interface < 0, 2e-4, 5e-5)
    springs = replace(on_springs(drive, part), compliance=1e-5 * np.eye(len(part)))
    force = respond(springs, LoadCycle.evenly(RATED, 0, 1.0, (0.5, 1.0))).equilibria.force
    np.testing.assert_allclose(secant_compliance(springs, force), part + 1e-5)
