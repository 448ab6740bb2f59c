"""Errors of cranks and gears at the output in closed form, crankshafts by energy, loose supports, a perfect unit."""

from dataclasses import replace

import numpy as np
import pytest
from reducers import STEEL

from pipeline import load_study
from pipeline.config.mechanisms.carrier import Carrier
from pipeline.config.mechanisms.crankshaft import Crankshaft, FirstStage
from pipeline.model.elastic.beam import shaft_flexibility
from pipeline.model.geometry.clearance import Errors, gaps
from pipeline.model.geometry.contacts import OUTPUT
from pipeline.model.geometry.cycloid_profile import CycloidProfile
from pipeline.model.geometry.reducer import nominal_reducer
from pipeline.model.geometry.rigid_play.rigid_backlash import general_play, rigid_play

PROFILE = CycloidProfile(pins=40, pin_circle_radius=77.5, pin_radius=4.0, eccentricity=1.5)
LOBES, SUN, PLANET, RADIUS, K = 39, 20, 40, 45.0, 3e5
PITCH = RADIUS * PLANET / (SUN + PLANET)
TORQUE = 4e5
SUPPORTS = (2.5e5, 1.6e5)
RV_80E = load_study("rv_80e").design.output.model_copy(update={"crankshaft": None})
"""The shipped mechanism with rigid shafts, whose disks share the load alike."""


def shaft(clearance=None, planet_plane=-8.0, plane=11.0, supports=SUPPORTS):
    return Crankshaft(
        span_mm=40.0,
        plane_mm=plane,
        disk_pitch_mm=15.0,
        planet_plane_mm=planet_plane,
        diameter_mm=18.0,
        material="steel",
        support_stiffness_N_per_mm_power=supports,
        support_clearance_um=clearance,
    )


def carrier(cranks=2, crankshaft=None, factors=None, backlash=0.0):
    stage = FirstStage(sun_teeth=SUN, planet_teeth=PLANET, backlash_um=backlash, mesh_stiffness_N_per_mm=2e5)
    return Carrier(
        mechanism="carrier",
        cranks=cranks,
        crank_circle_radius_mm=RADIUS,
        bearing_radius_mm=15.0,
        bearing_rollers=16,
        phase_deg=20.0,
        first_stage=stage,
        crankshaft=crankshaft,
        stiffness_of_cranks=factors,
    )


def both_sided(mechanism, reducer, gap=0.0):
    """Motion (n_motions,) and forces (n_contacts,), every contact a linear spring to both sides."""
    contacts = reducer.contacts
    stiffness = np.where(contacts.kind == OUTPUT, 2e5, 2e5)
    ring = (contacts.kind == OUTPUT) & (contacts.interface == 0)
    stiffness = np.where(ring, K / 8 * mechanism.bearing_factors[contacts.end], stiffness)
    if mechanism.has_loose_supports:
        support = (contacts.kind == OUTPUT) & (contacts.interface == 2)
        own = np.array(SUPPORTS)[contacts.face] / 8 * mechanism.bearing_factors[contacts.end]
        stiffness = np.where(support, own, stiffness)
    flexibility, rows = np.diag(1 / stiffness), np.flatnonzero(contacts.kind == OUTPUT)
    disk = reducer.disk_of_contact[rows]
    shafts = mechanism.compliance(contacts.some(rows), disk, {"steel": STEEL})
    if shafts is not None:
        flexibility[np.ix_(rows, rows)] += shafts
    inverse, jacobian = np.linalg.inv(flexibility), reducer.contact_jacobian
    load = np.eye(len(reducer.motions))[reducer.output_motion] * TORQUE
    motion = np.linalg.solve(
        jacobian.T @ inverse @ jacobian, load + jacobian.T @ inverse @ np.broadcast_to(gap, len(contacts))
    )
    return motion, inverse @ (jacobian @ motion - gap)


def forces_on_holes(mechanism, reducer):
    """Force (n_disks, n_cranks) complex of each crank on its hole of perfect disks, by the balance of moments alone."""
    n, disks, radius = mechanism.cranks, reducer.n_disks, mechanism.crank_circle_radius_mm
    sun, planet = mechanism.first_stage.sun_teeth, mechanism.first_stage.planet_teeth
    tangential = TORQUE * planet * LOBES / (sun + planet * 40) / (disks * n * radius)
    of_pins = -n * radius * tangential / (1.5 * LOBES)  # all their normals pass through the pitch point
    outwards = mechanism.centres() / radius * np.exp(1j * reducer.disks[0].rotation)
    pins = np.array([of_pins * 1j * np.exp(1j * disk.crank) for disk in reducer.disks])
    return -pins[:, None] / n + 1j * outwards * tangential


def closed_forms(mechanism, reducer, v):
    """Rotation of the output by the displacement ``v`` of each element of a dimension, by virtual work."""
    force, u = forces_on_holes(mechanism, reducer) / TORQUE, np.exp([1j * disk.crank for disk in reducer.disks])
    rotation, pitch = np.exp(1j * reducer.disks[0].rotation), mechanism.planet_pitch_radius_mm
    outwards = mechanism.centres() / mechanism.crank_circle_radius_mm * rotation
    ratio = 40 + mechanism.first_stage.sun_teeth / mechanism.first_stage.planet_teeth
    mesh = -1.5 * np.imag(np.conj(u)[:, None] * force).sum(axis=0) / pitch  # the moment of its eccentrics
    np.testing.assert_allclose(mesh.sum(), -1 / (pitch * ratio), rtol=1e-12)
    tangent = 1j * outwards

    def along(of, way):
        return np.real(np.conj(of) * way)

    stage = mechanism.first_stage
    sun_angle = reducer.disks[0].rotation * (1 + stage.planet_teeth * 40 / stage.sun_teeth)
    return {
        "crank_eccentricity": -along(force, u[:, None] * v).ravel(),
        "crank_phase": -along(force, 1j * u[:, None] * v).ravel(),
        "crank_position": -along(force, v * rotation).sum(axis=0) + mesh * along(tangent, v * rotation),
        "planet_runout": mesh * along(tangent, v * u[0]),
        "planet_timing": -mesh * v,
        "planet_backlash": np.zeros(mechanism.cranks),
        "sun_runout": -np.sum(mesh * along(tangent, v * np.exp(1j * sun_angle)), keepdims=True),
        "hole_position": along(force, v * rotation).ravel(),
        "bore_runout": -along(force, v * rotation).sum(axis=1),  # the flank one way is all holes the other
    }


@pytest.mark.parametrize("disks", [1, 2])
@pytest.mark.parametrize("mechanism", [carrier(2), carrier(3), RV_80E], ids=["two", "three", "rv_80e"])
@pytest.mark.parametrize("turn", [0.6, 2.9, 70.1])
def test_every_error_turns_the_output_as_its_closed_form_says(mechanism, disks, turn):
    cranks, size, way = mechanism.cranks, 1e-3, 1e-3 * np.exp(0.7j)
    reducer = nominal_reducer(PROFILE, mechanism, turn, disks=disks)
    directed = ("crank_position", "planet_runout", "sun_runout", "hole_position", "bore_runout")
    forms_of = {v: closed_forms(mechanism, reducer, v) for v in (size, way)}
    expected = {name: forms_of[way if name in directed else size][name] for name in forms_of[way]}
    perfect = both_sided(mechanism, reducer)[0][reducer.output_motion]
    zero = Errors.zero(PROFILE.pins, PROFILE.lobes, cranks)
    zero = replace(zero, roller_diameter=np.zeros((1, cranks * 18)))
    names = [n for n, matrix in reducer.displacements.items() for _ in range(matrix.shape[1])]
    scale = max(np.max(np.abs(values)) for values in expected.values())
    for name, forms in expected.items():
        for k, form in enumerate(forms):
            if name == "hole_position":
                off = np.zeros((1, disks, cranks), complex)
                off.flat[k] = -way  # the axis against the hole's
                errors = replace(zero, pin_off_hole=off if disks > 1 else off[:, 0])
            elif name == "bore_runout":
                runout = np.zeros((1, disks, 2))
                runout[0, k] = way.real, way.imag
                errors = replace(zero, bore_runout=runout if disks > 1 else runout[:, 0])
            else:
                displacement = np.zeros((1, len(names)), complex)
                displacement[0, names.index(name) + k] = way if name in directed else size
                errors = replace(zero, displacement=displacement)
            gap = gaps(PROFILE, reducer, errors, method="exact", disk_reading="radial", roller_reading="half_diameter")
            moved = both_sided(mechanism, reducer, gap[0])[0][reducer.output_motion] - perfect
            assert abs(moved - form) < 2e-3 * scale, (name, k)  # pins that lie unevenly about the eccentric: K^N


@pytest.mark.parametrize("cranks", [2, 3])
def test_shafts_in_preloaded_supports_are_those_that_move_in_rings_of_rollers(cranks):
    """Two derivations: a compliance between the contacts, and motions of the shaft on springs of its supports."""
    factors = tuple(np.linspace(1.0, 0.6, cranks))
    turned = []
    for crankshaft in (shaft(), shaft(clearance=0.0)):
        mechanism = carrier(cranks, crankshaft, factors)
        reducer = nominal_reducer(PROFILE, mechanism, 0.6, disks=2)
        motion, force = both_sided(mechanism, reducer)
        turned.append((motion[reducer.output_motion], force[: reducer.n_pins]))
    np.testing.assert_allclose(turned[0][0], turned[1][0], rtol=1e-9)
    np.testing.assert_allclose(turned[0][1], turned[1][1], atol=1e-8 * TORQUE / RADIUS)


@pytest.mark.parametrize("cranks", [2, 3])
def test_equal_shafts_turn_the_output_by_twice_their_energy_over_the_torque(cranks):
    """Reactions of the supports by levers and bending by moments, from forces of balance alone, two alike disks."""
    turns = []
    for crankshaft in (None, shaft(None, 20.0, 12.5, (2e5, 2e5))):
        mechanism = carrier(cranks, crankshaft)
        reducer = nominal_reducer(PROFILE, mechanism, 0.6, disks=2)
        turns.append(both_sided(mechanism, reducer)[0][reducer.output_motion])
    planes, holes = np.array([12.5, 27.5, 20.0]), -forces_on_holes(carrier(cranks), reducer)
    outwards = mechanism.centres() / RADIUS * np.exp(1j * reducer.disks[0].rotation)
    mesh = -TORQUE / (cranks * PITCH * (40 + SUN / PLANET)) * 1j * outwards
    x = np.linspace(0.0, 40.0, 40001)
    bending, shear = 206e3 * np.pi * 18.0**4 / 64, 206e3 / 2.6 * np.pi * 81.0 * 7.8 / 8.8
    energy = 0.0
    for crank in range(cranks):
        loads = np.array([*holes[:, crank], mesh[crank]])
        second = loads @ planes / 40.0
        reactions = np.array([loads.sum() - second, second])
        energy += np.sum(np.abs(reactions) ** 2 / 2e5) / 2
        steps = np.concatenate([loads, -reactions])[:, None] * (x > np.concatenate([planes, [0.0, 40.0]])[:, None])
        moments = np.concatenate([loads, -reactions])[:, None] * np.maximum(
            x - np.concatenate([planes, [0.0, 40.0]])[:, None], 0.0
        )
        density = np.abs(moments.sum(axis=0)) ** 2 / bending + np.abs(steps.sum(axis=0)) ** 2 / shear
        energy += 0.5 * np.sum(0.5 * (density[1:] + density[:-1])) * (x[1] - x[0])
    np.testing.assert_allclose(turns[1] - turns[0], 2 * energy / TORQUE, rtol=2e-3)


def test_a_shaft_bends_as_tables_of_beams_say():
    """Timoshenko and Gere, table of simple beams: load between supports, and an overhang; shear added."""
    f, bending = shaft_flexibility(np.array([12.0, 28.0, -8.0]), 40.0, 15.0, STEEL), 206e3 * np.pi * 15.0**4 / 64
    shear = 206e3 / 2.6 * np.pi * 15.0**2 / 4 * 7.8 / 8.8
    np.testing.assert_allclose(f[0, 0], (12.0 * 28.0) ** 2 / (3 * bending * 40) + 12.0 * 28 / 40 / shear, rtol=1e-12)
    far = 12.0 * 12 * (40.0**2 - 12**2 - 12**2) / (6 * bending * 40) + 12.0 * 12 / 40 / shear
    np.testing.assert_allclose(f[0, 1], far, rtol=1e-12)
    np.testing.assert_allclose(f[2, 2], 64 * 48 / (3 * bending) + (8 + 64 / 40) / shear, rtol=1e-12)
    np.testing.assert_allclose(f, f.T, rtol=1e-12)


@pytest.mark.parametrize("cranks", [2, 3])
def test_play_in_a_support_is_play_in_the_bearing_by_its_lever(cranks):
    """The planet at the tight support, one disk: rings of equal directions add up, the second support by its share."""
    plays = []
    for at_support, in_hole in ((8.0, 0.0), (0.0, 8.0 * 11 / 40)):
        mechanism = carrier(cranks, shaft(clearance=0.0, planet_plane=0.0), backlash=5.0)
        reducer = nominal_reducer(PROFILE, mechanism, 0.6)
        names = [n for n, matrix in reducer.displacements.items() for _ in range(matrix.shape[1])]
        displacement = np.where(np.array(names) == "second_support_clearance", 1e-3 * at_support, 0.0)[None] + 0j
        errors = Errors.zero(PROFILE.pins, PROFILE.lobes, cranks)
        errors = replace(
            errors,
            roller_diameter=np.zeros((1, cranks * (3 * 16 + 2))),
            displacement=displacement,
            hole_diameter=np.full((1, cranks), 2e-3 * (2.0 + in_hole)),
        )
        gap = gaps(PROFILE, reducer, errors, method="exact", disk_reading="radial", roller_reading="half_diameter")
        gap += np.where(reducer.contacts.kind == OUTPUT, 0.0, 3e-3)
        plays.append(rigid_play(reducer, gap, np.zeros(1)).backlash[0])
        np.testing.assert_allclose(general_play(reducer, gap, np.ones(1)).backlash, plays[-1], rtol=1e-8)
    np.testing.assert_allclose(plays[0], plays[1], rtol=1e-8)


@pytest.mark.parametrize("crankshaft", [None, shaft(), shaft(clearance=0.0)], ids=["rigid", "preloaded", "loose"])
def test_a_perfect_unit_keeps_its_ratio_over_the_turn(crankshaft):
    mechanism = carrier(3, crankshaft)
    for turn in np.linspace(0.0, 2 * np.pi * LOBES, 14):
        reducer = nominal_reducer(PROFILE, mechanism, turn, disks=2)
        ends = rigid_play(reducer, np.zeros((1, len(reducer.contacts))), np.zeros(1)).ends
        assert np.max(np.abs(np.degrees(ends) * 3600)) < 1e-6


def test_a_ratio_that_is_no_integer_has_a_period_of_several_turns():
    class Teeth:
        pins = 40

    stage = carrier().first_stage
    assert carrier().output_turns(Teeth) == 1  # 1 + 40 * 40/20 = 81
    uneven = carrier().model_copy(
        update={"first_stage": stage.model_copy(update={"sun_teeth": 12, "planet_teeth": 37})}
    )
    assert uneven.output_turns(Teeth) == 3  # 1 + 37 * 40/12 = 373/3


def orders(values):
    """Amplitudes of the orders of a turn from 0 of values (n,) evenly over it."""
    return np.abs(np.fft.rfft(values)) / len(values) * np.where(np.arange(len(values) // 2 + 1) == 0, 1, 2)


@pytest.mark.parametrize(
    ("factors", "crankshaft", "growing"),
    [
        ((1.0, 1.0), None, ()),
        ((1.0, 1.0), shaft(None, 20.0, 12.5, (2e5, 2e5)), ()),
        ((1.0, 0.4), None, (2,)),
        ((1.0, 1.0), shaft(), (2,)),
        ((1.0, 0.4), shaft(), (1, 2)),
    ],
    ids=["alike", "alike on shafts", "unlike cranks", "unlike supports", "both unlike"],
)
def test_bearings_that_are_unlike_give_the_compliance_orders_of_the_eccentrics(factors, crankshaft, growing):
    """Which a linear unit multiplies by the torque: some tenths of a percent to percents of its deflection.

    Like bearings are alike in all directions, and the force of the pins, which turns with the eccentrics, finds one
    compliance. Between two unlike cranks the loads move over twice a turn; disks at unlike supports meet either.
    """
    mechanism, turned = carrier(2, crankshaft, factors), []
    for angle in 2 * np.pi * np.arange(32) / 32:  # of a crank against the carrier
        reducer = nominal_reducer(PROFILE, mechanism, angle * LOBES / 40, disks=2)
        turned.append(both_sided(mechanism, reducer)[0][reducer.output_motion])
    waves = orders(np.array(turned)) / np.mean(turned)
    assert [order for order in (1, 2, 3, 4) if waves[order] > 1e-3] == list(growing)
    assert np.all(waves[[order for order in (1, 2, 3) if order not in growing]] < 1e-4)
