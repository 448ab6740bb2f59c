"""How a unit says that its crank turns, and what is made of it."""

import numpy as np
import pandas as pd
import pytest
from measured_bench import ROOT, path_of, write_unit

from pipeline.errors import InputError
from pipeline.identification.fitting.measured_loops import crank_loops
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit

TEXT = """
title = "A drive on a bench"
locked = "{locked}"
offset = "per_position"
[generic]
ratio = 13.0
rated_torque_Nm = 12.0
[crank]
{crank}
"""


def measured(folder, crank, locked="output") -> Measurement:
    torque = np.tile(path_of([0.0, 12.0, -12.0, 0.0], 80)[1:], 3)
    angle = 50.0 + 2.0 * torque
    rows = pd.DataFrame({"cycle": np.repeat([0, 1, 2], len(torque) // 3), "torque_Nm": torque, "angle_arcmin": angle})
    rows["motor_deg"] = 90.0 + 13 * angle / 60
    parts = [rows.assign(crank_deg=number) for number in (10.0, 700.0)]
    write_unit(folder, {"rows.csv": pd.concat(parts)}, TEXT.format(locked=locked, crank=crank))
    return Measurement.read(load_measured_unit(folder, ROOT))


def test_a_crank_that_follows_the_angle_and_one_given_by_a_column_are_the_same(tmp_path):
    text = 'ratio = -13.0\ntorque_at = "input"\n'
    following = crank_loops(measured(tmp_path / "a", f'moves = "follows_angle"\n{text}'))
    given = crank_loops(measured(tmp_path / "b", f'moves = "column"\ncolumn = "motor_deg"\n{text}'))
    assert following.at_input
    assert following.crank_per_output == pytest.approx(2 * np.pi * 13 / 21600)
    turn = following.crank + following.crank_per_output * (following.angle - following.start)
    np.testing.assert_allclose(turn, given.crank, atol=1e-9)
    first = following.position == 0
    assert np.ptp(following.crank[first]) == 0
    assert following.crank[first][0] == pytest.approx(np.radians(10.0))
    assert crank_loops(measured(tmp_path / "c", "", "input")).crank_per_output == 0


@pytest.mark.parametrize(
    ("crank", "locked", "message"),
    [
        ('moves = "follows_angle"', "output", "crank.ratio; where the crank moves"),
        ('moves = "follows_angle"\nratio = -13.0', "input", 'requires locked = "output"'),
        ('moves = "column"\nratio = -13.0', "output", "crank.column"),
    ],
)
def test_a_crank_that_cannot_move_so_is_refused(tmp_path, crank, locked, message):
    with pytest.raises(InputError, match=message):
        measured(tmp_path / "u", crank, locked)


def test_a_column_that_no_file_has_is_named(tmp_path):
    measurement = measured(tmp_path / "u", 'moves = "column"\ncolumn = "other"\nratio = -13.0')
    with pytest.raises(InputError, match='crank.column = "other"; no file has it'):
        crank_loops(measurement)
