"""Bending of the housing's ring and of the input shaft: handbooks, a ring that is cut, and motions of the shaft."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline import assembly
from pipeline.config import load_design, load_study
from pipeline.config.designs.design import HousingRing
from pipeline.config.mechanisms.crankshaft import Shaft
from pipeline.config.reading import parse_design
from pipeline.errors import InputError
from pipeline.model.elastic.beam import THICKEST, ring_flexibility
from pipeline.model.load_history.response import respond
from pipeline.mounting import drive_of
from pipeline.sampling.errors import draw
from tests.study.changed_files import changed

ROOT = Path(__file__).parents[3]
MODULUS, WIDTH = 206e3, 30.0


def flexibility(angle, direction, inner=80.0, outer=90.0):
    return ring_flexibility(np.exp(1j * np.asarray(angle)), np.asarray(direction), (inner, outer), WIDTH, MODULUS)


def test_two_opposite_forces_stretch_a_ring_as_the_handbook_says():
    """Timoshenko: the diameter along the forces by (pi/4 - 2/pi) P R^3/(E I), that across them by (2/pi - 1/2)."""
    along, across = np.array([1.0, -1.0, 0, 0]), np.array([0, 0, 1.0, -1.0])
    matrix = flexibility(0.5 * np.pi * np.array([0, 2, 1, 3]), [1.0, -1.0, 1j, -1j])  # all outwards
    stretch, hoop = matrix @ np.abs(along), 85.0 / (MODULUS * WIDTH * 10)
    unit = 85.0**3 / (MODULUS * WIDTH * 10**3 / 12)
    np.testing.assert_allclose(np.abs(along) @ stretch, (np.pi / 4 - 2 / np.pi) * unit + 2 * hoop / np.pi, rtol=1e-6)
    np.testing.assert_allclose(np.abs(across) @ stretch, -(2 / np.pi - 0.5) * unit + 2 * hoop / np.pi, rtol=1e-6)


def test_the_thickest_ring_is_some_ten_percent_softer_by_roark():
    """Roark's factors: hoop alpha = I/(A R^2), shear beta = 1.2 E I/(G A R^2) of a rectangle."""
    alpha = THICKEST**2 / 12
    k1, k2 = 1 - alpha + 1.2 * 2.6 * alpha, 1 - alpha
    softer = (k1 * np.pi / 4 - 2 * k2**2 / np.pi) / (np.pi / 4 - 2 / np.pi)
    assert 1.05 < softer < 1.11


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_forces_in_balance_bend_a_ring_by_the_energy_of_the_moments_of_a_cut_one(seed):
    """Second derivation: moments by statics, the three unknowns at the cut by least energy."""
    rng, inner, outer = np.random.default_rng(seed), 80.0, 80.4
    angle = np.sort(rng.uniform(0.1, 6.2, 6))
    place, force = inner * np.exp(1j * angle), rng.normal(size=6) + 1j * rng.normal(size=6)
    balance = np.array([np.ones(6), 1j * np.ones(6), 1j * place])  # forces along x and y, and the moment
    parts = np.hstack([balance.real, balance.imag])
    real = np.concatenate([force.real, force.imag])
    real -= parts.T @ np.linalg.solve(parts @ parts.T, parts @ real)
    force = real[:6] + 1j * real[6:]
    theta = (np.arange(200_000) + 0.5) * 2 * np.pi / 200_000
    centre = 0.5 * (inner + outer)
    section = centre * np.exp(1j * theta)
    moment = np.zeros_like(theta)
    for at, p, f in zip(angle, place, force, strict=True):
        moment += (theta > at) * np.imag(np.conj(p - section) * f)
    unknown = np.stack([np.ones_like(theta), section.real - centre, section.imag])
    moment -= unknown.T @ np.linalg.solve(unknown @ unknown.T, unknown @ moment)
    bending = MODULUS * WIDTH * (outer - inner) ** 3 / 12
    twice_energy = np.sum(moment**2) * centre * 2 * np.pi / len(theta) / bending
    size = np.abs(force)
    work = size @ flexibility(angle, force / size, inner, outer) @ size
    np.testing.assert_allclose(work, twice_energy, rtol=1e-4)


def bending_shaft(**settings):
    sizes = {"span_mm": 60.0, "plane_mm": 20.0, "disk_pitch_mm": 18.0, "diameter_mm": 25.0, "material": "steel"}
    return Shaft(**sizes, support_stiffness_N_per_mm_power=(3e5, 5e5), **settings)


def with_parts(name, shaft=None, ring=None):
    study = load_study(name, ROOT)
    housing = study.design.housing.model_copy(update={"ring": ring})
    return study.model_copy(
        update={"design": study.design.model_copy(update={"input_shaft": shaft, "housing": housing})}
    )


def drive_with(study, crank=40.0):
    errors = assembly.errors(draw(study, 0, 1))
    n = len(assembly.reducer(study.design, crank).contacts)
    loose = assembly.bearing_clearance(study.design, draw(study, 0, 1).bearing_clearance)
    return drive_of(study, crank, 1e-7 * np.eye(n), replace(errors), loose)


@pytest.mark.parametrize("name", ["pin_in_hole", "two_disks"])
def test_a_shaft_that_bends_takes_each_disk_along_by_its_forces(name):
    """Energy: what the contacts do by the shaft is what the disks' resultants do at its planes, reactions by levers."""
    shaft = bending_shaft()
    drive, rigid = (drive_with(with_parts(name, part)) for part in (shaft, None))
    reducer, added = drive.reducer, drive.compliance - rigid.compliance
    rng = np.random.default_rng(4)
    force = rng.uniform(0, 100, len(reducer.contacts))
    normal, disk = reducer.contacts.normal, reducer.disk_of_contact
    sign = np.where(np.char.startswith(reducer.contacts.body_b.astype(str), "disk"), 1.0, -1.0)  # it pushes body b
    on_disk = np.array([np.sum((sign * force * normal)[disk == k]) for k in range(reducer.n_disks)])
    planes = shaft.planes(reducer.n_disks)
    reactions = np.array([np.sum(on_disk * (1 - planes / 60.0)), np.sum(on_disk * planes / 60.0)])
    stiffness, second_moment = 206e3, np.pi * 25.0**4 / 64
    shear = stiffness / 2.6 * np.pi * 25.0**2 / 4 * 7.8 / 8.8
    x = (np.arange(60_000) + 0.5) / 1000
    moment, cut = reactions[0] * x + 0j, reactions[0] + 0j * x
    for f, plane in zip(on_disk, planes, strict=True):
        moment -= f * np.maximum(x - plane, 0)
        cut -= f * (x > plane)
    energy = np.sum(np.abs(moment) ** 2 / (stiffness * second_moment) + np.abs(cut) ** 2 / shear) / 1000
    energy += np.sum(np.abs(reactions) ** 2 / np.array([3e5, 5e5]))
    np.testing.assert_allclose(force @ added @ force, energy, rtol=1e-6)


@pytest.mark.parametrize(
    "part", [{"shaft": bending_shaft()}, {"ring": HousingRing(width_mm=60.0, material="steel")}], ids=["shaft", "ring"]
)
def test_a_loaded_reducer_turns_farther_by_what_its_shaft_or_housing_stores(part):
    """Engesser: to first order in a soft part, the work of its twist over the torque is its energy F C F/2."""
    loads = assembly.load_cycle(load_study("two_disks", ROOT), 24)
    rigid = drive_with(with_parts("two_disks"))
    added = 1e-3 * (drive_with(with_parts("two_disks", **part)).compliance - rigid.compliance)
    turned, force = [], []
    for drive in (rigid, replace(rigid, compliance=rigid.compliance + added)):
        equilibria = respond(drive, loads).equilibria
        turned.append(equilibria.motion[0, :, drive.reducer.output_motion])
        force.append(equilibria.force[0])
    torque = loads.state_torque
    rising = np.argsort(torque)[-20:]  # the sense +, from under a fifth of the torque
    work = np.trapezoid((turned[1] - turned[0])[rising], torque[rising])
    first, last = (0.5 * force[0][k] @ added @ force[0][k] for k in rising[[0, -1]])
    assert last > 2 * first > 0
    np.testing.assert_allclose(work, last - first, rtol=5e-3)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("input_shaft", {"span_mm": 30.0}, "input_shaft.span_mm = 30.0; must be > 38 mm, the plane of the last disk"),
        ("input_shaft", {"span_mm": 400.0}, "input_shaft.span_mm = 400.0; must be 25 to 250 mm"),
        ("input_shaft", {"material": "stel"}, 'input_shaft.material = "stel"; no such section [materials.stel]'),
        ("housing.ring", {"width_mm": 30.0, "material": "x"}, 'housing.ring.material = "x"; no such section'),
        ("housing.outer_diameter_mm", 400.0, "housing.outer_diameter_mm = 400.0; must be <="),
    ],
)
def test_a_shaft_that_is_no_beam_and_a_thick_housing_are_refused(key, value, message):
    data = tomllib.loads((ROOT / "data/designs/two_disks_39.toml").read_text(encoding="utf-8"))
    if key == "input_shaft":
        value = bending_shaft().model_dump() | value
    if key.startswith("housing.outer"):
        data = changed(data, "housing.ring", {"width_mm": 30.0, "material": "steel"})
    with pytest.raises(InputError, match=re.escape(message)):
        parse_design(changed(data, key, value), "d.toml")


def test_a_carrier_has_no_input_shaft():
    data = load_design("rv_80e", ROOT).model_dump(exclude_none=True, exclude={"thermal"})
    with pytest.raises(InputError, match="input_shaft; acts on nothing: the disks run on the cranks of the carrier"):
        parse_design(data | {"input_shaft": bending_shaft().model_dump()}, "d.toml")
