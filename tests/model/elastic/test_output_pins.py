"""Output pins with bushes, and pins that bend: closed forms, Castigliano's integrals, and what couples two disks."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from pipeline import assembly
from pipeline.config import load_design, load_study
from pipeline.config.mechanisms.pin_in_hole import Bending, Bush
from pipeline.model.contact.laws import Material
from pipeline.model.elastic.beam import pin_flexibility
from pipeline.model.geometry.contacts import OUTPUT
from pipeline.model.geometry.rigid_play.rigid_backlash import rigid_play
from pipeline.mounting import drive_of
from pipeline.sampling.errors import draw

ROOT = Path(__file__).parents[3]
PIN = Material(206e3, 0.3, "plane_stress")
DIAMETER, SPAN = 12.0, 60.0
BENDING = 206e3 * np.pi * DIAMETER**4 / 64
SHEAR = 206e3 / 2.6 * np.pi * DIAMETER**2 / 4 * 7.8 / 8.8  # k G A, k = 6 (1 + nu)/(7 + 6 nu)


def castigliano(planes, span):
    """Deflections by unit loads from energies alone; a clamp at the end is a force and a moment that move nothing."""
    length = span or max(planes)
    loads = [(lambda x, a=a: (a - x if x < a else 0.0, 1.0 if x < a else 0.0)) for a in planes]
    ends = [lambda x: (length - x, 1.0), lambda x: (1.0, 0.0)]  # moment and shear by a force and a moment at the end

    def energy(force_a, force_b):
        def density(x):
            (m, v), (n, w) = force_a(x), force_b(x)
            return m * n / BENDING + v * w / SHEAR

        return quad(density, 0, length, points=sorted(planes), epsabs=0, epsrel=1e-12)[0]

    free = np.array([[energy(a, b) for b in loads] for a in loads])
    if span is None:
        return free
    deflections = np.array([[energy(a, b) for b in ends] for a in loads])
    return free - deflections @ np.linalg.solve([[energy(a, b) for b in ends] for a in ends], deflections.T)


@pytest.mark.parametrize("planes", [[30.0], [14.0, 33.0], [11.0, 27.0, 52.0]])
@pytest.mark.parametrize("span", [None, SPAN])
def test_the_flexibility_of_a_pin_is_castiglianos(planes, span):
    flexibility = pin_flexibility(np.array(planes), DIAMETER, PIN, span)
    np.testing.assert_allclose(flexibility, castigliano(planes, span), rtol=1e-10)
    np.testing.assert_allclose(flexibility, flexibility.T, rtol=1e-12)
    assert (np.linalg.eigvalsh(flexibility) > 0).all()


def test_a_cantilever_and_a_clamped_beam_have_the_handbooks_deflections():
    (cantilever,), (clamped,) = pin_flexibility([SPAN], DIAMETER, PIN, None), pin_flexibility([30], DIAMETER, PIN, SPAN)
    np.testing.assert_allclose(cantilever, SPAN**3 / (3 * BENDING) + SPAN / SHEAR)
    np.testing.assert_allclose(clamped, SPAN**3 / (192 * BENDING) + SPAN / (4 * SHEAR))


def holes(**settings):
    study = load_study("pin_in_hole", ROOT)
    output = study.design.output.model_copy(update=settings)
    return study.model_copy(update={"design": study.design.model_copy(update={"output": output})})


def test_a_pin_gives_way_under_its_own_disks_alone_each_along_its_normal():
    bending = Bending(support="both_ends", plane_mm=20.0, disk_pitch_mm=18.0, span_mm=SPAN)
    design = holes(bending=bending).design
    reducer = assembly.reducer(design, 40.0)
    item = reducer.contacts.some(np.flatnonzero(reducer.contacts.kind == OUTPUT))
    tilted = replace(item, normal=item.normal * np.exp(2.1j))
    pair = type(item)(*(np.concatenate([getattr(item, name), getattr(tilted, name)]) for name in vars(item)))
    matrix = design.output.compliance(pair, np.repeat([0, 1], 10), {"steel": PIN})
    pin = pin_flexibility([20.0, 38.0], DIAMETER, PIN, SPAN)
    expected = np.kron([[pin[0, 0], pin[0, 1] * np.cos(2.1)], [pin[0, 1] * np.cos(2.1), pin[1, 1]]], np.eye(10))
    np.testing.assert_allclose(matrix, expected, rtol=1e-12, atol=1e-20)


def test_a_drive_has_the_compliance_of_its_pins_beside_that_of_the_disk():
    study = holes(bending=Bending(support="cantilever", plane_mm=SPAN))
    errors = assembly.errors(draw(study, 0, 1))
    disk_compliance = np.full((50, 50), 1e-7)
    drive = drive_of(study, 40.0, disk_compliance, errors, np.zeros(1))
    soft = SPAN**3 / (3 * BENDING) + SPAN / SHEAR
    np.testing.assert_allclose(
        drive.compliance - disk_compliance, np.diag(np.repeat([0.0, soft], [40, 10])), atol=1e-18
    )
    assert not np.any(drive_of(study, 40.0, None, errors, np.zeros(1)).compliance)


def test_a_bush_puts_two_contacts_and_two_clearances_in_series():
    bush = Bush(outer_radius_mm=8.0, clearance_um=20.0, material="steel")
    study = holes(bush=bush)
    reducer = assembly.reducer(study.design, 37.0)
    values = reducer.contacts.kind == OUTPUT
    np.testing.assert_allclose(reducer.contacts.gap[values], 0.005 + 0.020, atol=1e-12)
    np.testing.assert_allclose(-1 / reducer.contacts.curvature[values], 8.0 + 1.2 + 0.005)
    wider, narrow = (
        rigid_play(reducer, (0.1 * ~values + values * gap)[None], np.zeros(1)).backlash for gap in (0.025, 0.005)
    )
    arm = reducer.contacts.arm[values]
    np.testing.assert_allclose(wider - narrow, 0.020 * (1 / arm.max() - 1 / arm.min()), rtol=1e-9)
    force = np.array([10.0, 100.0])[:, None] * np.ones(10)
    share, middle = 2 * force / 15 / (np.pi * 206e3), 0.5 * (8.0 - 6.02)
    half = {
        name: np.sqrt(4 * force / 15 * radius / (np.pi * 206e3 / 2))
        for name, radius in (("outer", 8 * 9.205 / 1.205), ("inner", 6 * 6.02 / 0.02))
    }
    expected = share * (
        (np.log(2 * middle / half["outer"]) - 0.15)  # the wall from outside to its middle
        + (np.log(0.6 / half["outer"]) + 0.25)  # what the mesh of the disk does not hold
        + (np.log(2 * middle / half["inner"]) - 0.15)  # the wall from within
        + (np.log(4 * 6 / half["inner"]) - 0.5)  # the pin to its axis
    )
    laws = assembly.contact_laws(study, reducer)[reducer.n_pins :]
    assert (laws.force_limit > 100).all()
    np.testing.assert_allclose(laws.deflection(force), expected, rtol=1e-9)


def test_the_report_names_bushes_and_bending():
    design = load_design("pin_in_hole_39", ROOT)
    bush = Bush(outer_radius_mm=8.0, clearance_um=20.0, material="steel")
    bending = Bending(support="cantilever", plane_mm=SPAN)
    output = design.output.model_copy(update={"bush": bush, "bending": bending})
    fact = output.fact(design.cycloid, lambda number: f"{number:g}")
    assert "with loose bushes of outer radius 8 mm, in holes of the disk of radius 9.205 mm" in fact
    assert fact.endswith("the pins bend as cantilevers")
