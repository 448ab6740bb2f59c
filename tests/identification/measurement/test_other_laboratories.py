"""Files of other laboratories: of the motor side, in other units, without crank angles."""

import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from measured_bench import ROOT, loop, path_of, write_unit

from pipeline.errors import InputError
from pipeline.identification.described.description import describe
from pipeline.identification.described.results import HELD, implausible_numbers
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit

RATIO = 29.0
TEXT = """
title = "A bench elsewhere"
locked = "output"
offset = "per_position"
{side}
[generic]
ratio = 29.0
rated_torque_Nm = 25.0
[columns]
time_s = {{name = "Zeit", unit = "ms"}}
cycle = {{name = "Versuch"}}
torque_Nm = {{name = "Moment", unit = "mN m"}}
angle_arcmin = {{name = "Winkel", unit = "mrad"}}
"""
MRAD = 3.4377467707849396


def at_motor(folder, side: str = 'side = "input"', play: float = 30.0) -> Measurement:
    """A record of the motor side: mrad, mN m, semicolons, decimal commas, a file for each position, no crank angle."""
    rng = np.random.default_rng(1)
    write_unit(folder, {}, TEXT.format(side=side))
    for number in range(3):
        torque = np.tile(path_of([0.0, 25.0, -25.0, 0.0], 40)[1:], 3)
        angle = loop(torque, play=play, rigidity=0.5, friction=1.0) + 0.05 * rng.standard_normal(torque.size)
        columns = {
            "Zeit": 20 * np.arange(torque.size),
            "Versuch": np.repeat([1, 2, 3], torque.size // 3),
            "Moment": 1e3 * torque / RATIO,
            "Winkel": (angle + 40.0 * number) * RATIO / MRAD,
        }
        pd.DataFrame(columns).to_csv(folder / f"pos{number}.csv", sep=";", decimal=",", index=False)
    return Measurement.read(load_measured_unit(folder, ROOT))


@pytest.mark.long
def test_a_record_of_the_motor_side_is_that_of_the_output(tmp_path):
    measurement = at_motor(tmp_path / "bench")
    assert not measurement.faults
    assert measurement.rows.cranks.tolist() == [0.0, 1.0, 2.0]
    assert np.max(measurement.rows.torque) == pytest.approx(25.0, rel=1e-9)
    values = {number.term: number.value for number in describe(measurement).numbers}
    assert values["play"] == pytest.approx(30.0, rel=0.15)
    assert values["friction"] == pytest.approx(1.0, rel=0.15)


@pytest.mark.long
def test_without_its_side_the_record_is_doubted_before_and_after_the_fit(tmp_path):
    measurement = at_motor(tmp_path / "bench", side="")
    (note,) = measurement.faults
    assert note.severity == "note"
    assert 'say side = "input" (ratio 29)' in note.message
    doubts = implausible_numbers(describe(measurement))
    assert any("a play of" in doubt and "implausible" in doubt for doubt in doubts)
    assert HELD not in doubts


@pytest.mark.long
def test_a_crank_that_turns_is_not_passed_over_in_silence(tmp_path):
    at_motor(tmp_path / "bench")
    file = tmp_path / "bench" / "unit.toml"
    file.write_text(file.read_text() + '\n[crank]\nmoves = "follows_angle"\nratio = -29.0\n')
    assert HELD in implausible_numbers(describe(Measurement.read(load_measured_unit(file, ROOT))))


def test_a_side_that_cannot_move_is_refused(tmp_path):
    at_motor(tmp_path / "bench")
    text = TEXT.format(side='side = "input"').replace('locked = "output"', 'locked = "input"')
    (tmp_path / "bench" / "unit.toml").write_text(text)
    with pytest.raises(InputError, match='must be "output" where the input is locked'):
        load_measured_unit(tmp_path / "bench", ROOT)


def test_faults_of_unit_file_and_tables_are_one_answer(tmp_path):
    at_motor(tmp_path / "bench")
    (tmp_path / "bench" / "pos1.csv").write_text("Zeit;Versuch;Moment;Winkel\n1;2\n")
    (tmp_path / "bench" / "unit.toml").write_text(TEXT.format(side='side = "motor"').replace('"mN m"', '"mNm"'))
    with pytest.raises(InputError) as caught:
        load_measured_unit(tmp_path / "bench", ROOT)
    text = "\n".join(caught.value.problems)
    assert "side" in text
    assert "mNm" in text
    assert "pos1.csv" in text


def test_a_missing_column_hides_no_other_fault(tmp_path):
    text = TEXT.format(side='side = "input"').replace('"Versuch"', '"Zyklus"').replace('"mN m"', '"N m"')
    at_motor(tmp_path / "bench")
    (tmp_path / "bench" / "unit.toml").write_text(text)
    kinds = {fault.kind for fault in Measurement.read(load_measured_unit(tmp_path / "bench", ROOT)).faults}
    assert kinds >= {"missing column", "unit"}


@pytest.mark.long
def test_a_number_at_the_bound_of_the_fit_is_not_claimed(tmp_path):
    """Friction beyond what a fit allows puts every fit on the bound: no scatter between them is no certainty."""
    write_unit(tmp_path / "bench", {}, TEXT.format(side="").replace("rated_torque_Nm = 25.0", "rated_torque_Nm = 12.0"))
    torque = np.tile(path_of([0.0, 12.0, -12.0, 0.0], 40)[1:], 3)
    carried, angle = 0.0, []
    for load in torque:
        carried = min(max(carried, load - 9.0), load + 9.0)
        angle.append(2.0 * carried)
    for number in range(4):
        noise = 0.01 * np.random.default_rng(number).standard_normal(torque.size)
        columns = {
            "Versuch": np.repeat([1, 2, 3], torque.size // 3),
            "Moment": 1e3 * torque,
            "Winkel": (angle + noise) / MRAD,
        }
        frame = pd.DataFrame({"Zeit": 20 * np.arange(torque.size), **columns})
        frame.to_csv(tmp_path / "bench" / f"pos{number}.csv", index=False)
    numbers = {n.term: n for n in describe(Measurement.read(load_measured_unit(tmp_path / "bench", ROOT))).numbers}
    assert numbers["load_friction"].note == "at the bound of the fit"
    assert not numbers["load_friction"].named
    assert np.isnan(numbers["load_friction"].ci_low)


def test_the_first_message_comes_before_the_libraries(tmp_path):
    """Counted in processor time, which a busy machine does not change; with all libraries it would be 2 s."""
    at_motor(tmp_path / "bench")
    code = (
        "import sys, time\n"
        "class Stop(BaseException): pass\n"
        "class Out:\n"
        "    def write(self, text):\n"
        "        sys.stderr.write(f'{time.process_time():.3f} {text}'); raise Stop\n"
        "    def flush(self): pass\n"
        "sys.stdout = Out()\n"
        "from pipeline.cli import main\n"
        f"main(['identify', '--unit', {str(tmp_path / 'bench')!r}])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    first = done.stderr.splitlines()[0]
    assert "reading" in first
    assert float(first.split()[0]) < 1.0
