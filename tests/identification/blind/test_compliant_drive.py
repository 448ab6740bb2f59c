"""The third simulator of blind units against closed forms and against the second, which shares no code with it."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.config.designs.design import Design
from pipeline.identification.fitting.problem import candidates
from pipeline.identification.measurement.unit_file import load_measured_unit
from tests.identification.blind.test_rigid_drive import reducer, without_errors
from tests.validation.blind import command_line
from tests.validation.blind.command_line import SEAL, TRUTH, designs
from tests.validation.blind.compliant_drive.causes import LIBRARY, drawn_law, work_taken
from tests.validation.blind.compliant_drive.drawing import drawn_parts
from tests.validation.blind.compliant_drive.statics import (
    PowerLaw,
    carried,
    coupled_compliance,
    delayed,
    rayleigh_twist,
)
from tests.validation.blind.compliant_drive.unit import KINDS, LARGEST_SHARE, NO_WORK, drawn_unit, kind_of
from tests.validation.blind.rigid_unit import rigid_drive

ROOT = Path(__file__).parents[3]
HELD_OUT_SEED = 1
"""Of the units of these tests; no rate is reported on it."""


OF_ONE = next(case for case in range(9) if kind_of(case) == "one")
"""A case of one effect."""


@pytest.fixture(scope="module")
def parts():
    """Parts of an elastic drive without errors, contacts after Palmgren."""
    drawn = drawn_parts(np.random.default_rng(3), designs(ROOT), elastic=True)
    exact = {key: np.zeros_like(value) for key, value in drawn.errors.items()}
    return replace(drawn, errors=exact, factors=dict.fromkeys(drawn.factors, 1.0))


@pytest.fixture(scope="module")
def unit_of_one():
    """A unit with one effect."""
    return drawn_unit(HELD_OUT_SEED, OF_ONE, designs(ROOT), elastic=False)


@pytest.fixture(scope="module")
def unit():
    """A unit with nothing put in."""
    return drawn_unit(HELD_OUT_SEED, 0, designs(ROOT), elastic=False)


def test_slopes_and_curvatures_are_those_of_the_energy(parts):
    disk, rng = parts.disk(33.0), np.random.default_rng(0)
    pose = np.array([1.0, -2.0, 3.0, 40.0])
    _, slope, curvature = disk.energy(pose, 2e5)
    for direction in rng.standard_normal((4, 4)):
        step = 1e-4 * direction / np.linalg.norm(direction)
        ahead, behind = disk.energy(pose + step, 2e5), disk.energy(pose - step, 2e5)
        assert (ahead[0] - behind[0]) / 2 == pytest.approx(slope @ step, rel=1e-5)
        # the curvature leaves out what bends a slope itself: a few parts in a thousand
        assert (ahead[1] - behind[1]) / 2 == pytest.approx(curvature @ step, rel=0.02, abs=1e-5 * np.linalg.norm(slope))


def test_forces_balance_and_the_disk_gives_way_to_them(parts):
    disk = parts.disk(33.0)
    pose = disk.balanced(3e5, np.zeros(4))
    pressed = disk.approaches(pose)[0]
    force = disk.pin_forces(pressed)[0]
    local = (force / disk.at_pins.stiffness) ** (1 / disk.at_pins.power)
    touching = force > 0
    assert touching.sum() > 5
    assert local[touching] == pytest.approx((pressed - disk.compliance @ force)[touching], rel=1e-6)
    assert np.all((pressed - disk.compliance @ force)[~touching] <= 1e-9)


def test_a_coupled_compliance_is_symmetric_and_takes_work_under_any_loads():
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    places = (60 + 3 * np.cos(11 * angle)) * np.exp(1j * angle)
    matrix = coupled_compliance(places, angle + 0.5 * np.sin(7 * angle), 10.0, 2e5, 40.0, 0.3)
    assert matrix == pytest.approx(matrix.T)
    assert np.linalg.eigvalsh(matrix).min() > 0
    # a line load on a half-plane: two points at 1 and 2 mm differ by 2 ln 2 / (pi E t)
    near, far = coupled_compliance(np.array([0, 1, 2], complex), np.zeros(3), 10.0, 2e5, 1e9, 0.0 + 1e-12)[0, 1:]
    assert near - far == pytest.approx(1e3 * 2 * np.log(2) / (np.pi * 2e5 * 10))


def test_a_rigid_disk_follows_the_second_simulator(parts):
    """Both take poses as they are; with Palmgren's law, no errors and an equal bearing their curves are one."""
    study = reducer("holes_39").rigid_truth
    second = rigid_drive(study.design, without_errors(study), 33.0)
    gear = study.design.cycloid
    counts = {"pin": gear.pins, "lobe": gear.pins - 1, "roller": study.design.output.pins}
    zero = {name: np.zeros(counts.get(name.split("_")[0], 1)) for name in parts.errors}
    zero["eccentricity"] = np.zeros(())
    palmgren = replace(parts, elastic=False, power=1 / 0.9, law_size=1.0, design=study.design.model_dump(), errors=zero)
    disk, largest = palmgren.disk(33.0), 4e5
    ours, theirs = disk.curve(largest), second.curve(largest)
    torque = largest * np.array([-1.0, -0.6, -0.2, 0.2, 0.6, 1.0])
    span = np.ptp(theirs.at(torque))
    assert ours.at(torque) == pytest.approx(theirs.at(torque), abs=2e-3 * span)


def test_friction_is_a_play_of_the_torque():
    torque = np.concatenate([np.linspace(0, 10, 200), np.linspace(10, -10, 400), np.linspace(-10, 10, 400)])
    inside = carried(torque, 1.0, 0.1)
    assert inside[199] == pytest.approx(9 / 1.1)
    assert inside[599] == pytest.approx(-9 / 1.1)
    # just after the reversal the drive holds still until friction is overcome in the other sense
    assert inside[201] == inside[199]
    assert carried(torque, 1.0, 0.0)[199] == pytest.approx(9.0)


def test_rayleighs_loop_has_the_area_of_four_thirds():
    torque = np.concatenate([np.linspace(0, 2, 500), np.linspace(2, -2, 1000), np.linspace(-2, 2, 1000)])
    twist = rayleigh_twist(torque, 0.3)
    loop = slice(499, None)
    assert abs(np.trapezoid(torque[loop], twist[loop])) == pytest.approx(4 / 3 * 0.3 * 2**3, rel=1e-4)


def test_a_minor_loop_closes_where_it_left_the_branch():
    legs = [(0, 2), (2, -1), (-1, 1), (1, -2)]
    torque = np.concatenate([np.linspace(*leg, 301) for leg in legs])
    twist = rayleigh_twist(torque, 0.3)
    without = rayleigh_twist(np.concatenate([np.linspace(0, 2, 301), np.linspace(2, -2, 401)]), 0.3)
    assert twist[-1] == pytest.approx(without[-1], rel=1e-9)


def test_a_lag_is_the_rate_times_its_constant():
    time = np.linspace(0, 50, 5001)
    assert 2 * time[-1] - delayed(2 * time, time, 3.0)[-1] == pytest.approx(6.0, rel=1e-6)


def test_effects_have_the_names_and_the_numbers_of_the_library(unit):
    library, rng = candidates(), np.random.default_rng(0)
    position = unit.positions[0]
    for name, cause in LIBRARY.items():
        assert len(cause.sizes(position.disk, position.course, rng)) == len(library[name].parameters)


@pytest.mark.long
def test_a_unit_is_the_same_whatever_was_drawn_before_and_hides_its_truth(tmp_path, unit, unit_of_one):
    first, again = unit_of_one, drawn_unit(HELD_OUT_SEED, OF_ONE, designs(ROOT), elastic=False)
    assert first.truth == again.truth
    first.write(tmp_path / "a")
    again.write(tmp_path / "b")
    assert (tmp_path / "a" / "data.csv").read_bytes() == (tmp_path / "b" / "data.csv").read_bytes()
    unit = load_measured_unit(tmp_path / "a", ROOT)
    assert isinstance(unit.study.design, Design)
    assert not {SEAL, TRUTH} & {path.name for path in (tmp_path / "a").iterdir()}
    text = "".join(path.read_text() for path in (tmp_path / "a").iterdir())
    assert first.truth["truth"] not in text


def test_every_run_has_the_proportions_of_the_full_one():
    kinds = [kind_of(case) for case in range(56)]
    assert [kinds.count(kind) for kind in KINDS] == [20, 20, 6, 10]


def test_no_drawn_law_gives_back_work(unit):
    rng = np.random.default_rng(11)
    taken = []
    for _ in range(40):
        law = drawn_law(rng)
        sense = unit.sense_of(law)
        if sense:
            taken += [work_taken(at.course, law.angle(at, LARGEST_SHARE * sense)) for at in unit.positions]
    assert len(taken) > 12
    assert min(taken) > -2 * NO_WORK


def test_a_power_law_is_met_by_one_contact(unit):
    law = PowerLaw(2.0, 1.5)
    disk = replace(unit.positions[0].disk, at_pins=law)
    pressed = np.full(len(disk.pins), -1.0)
    pressed[2] = 4.0
    force, energy, slope = disk.pin_forces(pressed)
    assert force[2] == pytest.approx(2 * 4**1.5)
    assert energy == pytest.approx(2 * 4**2.5 / 2.5)
    assert slope[2, 2] == pytest.approx(3 * 4**0.5)


def test_the_truth_is_sealed_until_the_verdict_is_stored(tmp_path, monkeypatch, unit_of_one):
    seen = []

    def identified(path, home, root):
        seen.append({file.name for file in path.iterdir()})
        verdict = {"verdict": "identified", "named": ["coulomb"], "parameters": [], "noise": {"floor_arcmin": 0.1}}
        return verdict, 3.0, ""

    monkeypatch.setattr(command_line, "drawn_unit", lambda *_: unit_of_one)
    monkeypatch.setattr(command_line, "_identified", identified)
    row = command_line.one_unit(HELD_OUT_SEED, OF_ONE, "code", ROOT, tmp_path)
    assert SEAL in seen[0]
    assert TRUTH not in seen[0]
    truth = json.loads(next(tmp_path.rglob(TRUTH)).read_text())
    assert row.truth == truth["truth"]
    assert row.correct == (truth["truth"] == "coulomb")
    assert row.kind == "one"
    assert row.seconds == 3.0
