"""From files to the problem: what the data offer, and how its cells are weighted."""

import numpy as np
import pytest
from synthetic_unit import Bench, make_unit, problem_of

from pipeline.identification.fitting.problem import candidates
from pipeline.model.effects.effect import STILL


@pytest.mark.parametrize("locked", ["input", "output"])
def test_a_locked_output_lets_the_crank_turn_beyond_the_pins_pitch(locked, tmp_path, condensed):
    """Six arcmin of twist are 8 degrees of the crank at the ratio 79, and half a pitch of 80 pins is 2.25."""
    problem = problem_of(make_unit(tmp_path / "u", {}, Bench(locked=locked), condensed), condensed)
    why_not = problem.why_not(candidates()["contact_friction"])
    assert (STILL in problem.offered) == (locked == "input")
    assert why_not == "" if locked == "input" else "load_friction" in why_not


def test_cells_of_more_rows_are_known_better_by_the_noise_of_their_rows(tmp_path, condensed):
    """Of independent rows the variance of a cell goes with one over their number."""
    bench = Bench(cycles=4, rows=200, noise=0.05)
    data = problem_of(make_unit(tmp_path / "u", {}, bench, condensed), condensed).data
    calm = np.abs(data.torque) > 3.0  # beyond the play, where the noise of the torque plays no part
    many, few = calm & (data.count >= 12), calm & (data.count <= 8)
    ratio = np.median(data.sigma[few] ** 2 * data.count[few]) / np.median(data.sigma[many] ** 2 * data.count[many])
    assert many.sum() > 5
    assert few.sum() > 5
    assert 0.7 < ratio < 1.4
    assert np.median(data.sigma[few]) > 1.2 * np.median(data.sigma[many])
