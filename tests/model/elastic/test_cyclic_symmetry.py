"""Condensation by cyclic symmetry against the factorised whole body and against Michell's series for an annulus."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import j1
from skfem import MeshTri

from pipeline import assembly, elastic
from pipeline.config.reading import load_study
from pipeline.model.elastic.condensed_body import elastic_body
from pipeline.model.elastic.disk_mesh import flank_nodes, lobed_disk_mesh
from pipeline.model.elastic.pressure_patches import boundary_patches, joined_patches, line_patches
from pipeline.model.geometry.cycloid_profile import CycloidProfile

E, NU, THICKNESS = 206e3, 0.3, 1.7
ODD = CycloidProfile(pins=12, pin_circle_radius=10.0, pin_radius=1.0, eccentricity=0.55)
EVEN = CycloidProfile(pins=13, pin_circle_radius=10.0, pin_radius=1.0, eccentricity=0.5)
FEWEST = CycloidProfile(pins=4, pin_circle_radius=10.0, pin_radius=1.0, eccentricity=0.8)


def body_of(profile, stress="plane_stress", edges=24):
    mesh = lobed_disk_mesh(flank_nodes(profile, edges), profile.lobes, 2.5, growth=0.35, largest_edge=0.8)
    return elastic_body(mesh, E, NU, THICKNESS, stress, "bore", profile.lobes)


def patches_of(body, profile, phase):
    """A patch of every pin, shifted by ``phase`` of a pin's pitch, and two slides' stations across several sectors."""
    psi = 2 * np.pi * (np.arange(profile.pins) + phase) / profile.pins
    flank = boundary_patches(body.mesh, "flank", profile.flank(psi), profile.normal(psi), 0.3)
    turn = np.exp(0.7j * phase)
    stations = np.array([4.5j, -5.5j, 4.2 - 1.2j, -6 + 1.2j]) * turn
    return joined_patches(
        flank, line_patches(body.mesh, stations, [turn, turn, 1j * turn, 1j], np.array([1j, 1, 1j, 2]), 1.2)
    )


@pytest.mark.parametrize("stress", ["plane_stress", "plane_strain"])
@pytest.mark.parametrize("profile", [ODD, EVEN, FEWEST])
def test_sectors_give_the_compliance_and_displacement_of_the_whole_body(profile, stress):
    body = body_of(profile, stress)
    whole = replace(body, sectors=1)
    for phase in (0.0, 0.37, 0.81):
        patches = patches_of(body, profile, phase)
        exact = whole.compliance(patches).matrix
        compliance = body.compliance(patches)
        np.testing.assert_allclose(compliance.matrix, exact, rtol=0, atol=1e-9 * np.abs(exact).max())
        assert compliance.asymmetry < 1e-12
    forces = np.linspace(-20, 50, len(patches))
    displacement, expected = (b.nodal_displacement(patches, forces) for b in (body, whole))
    np.testing.assert_allclose(displacement, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.long
def test_the_papers_disk_by_its_79_sectors_is_the_whole_disk():
    """Its pins and rollers at crank angles of 31 over a turn, on a coarse mesh."""
    study = load_study("quick", Path(__file__).parents[3])
    coarse = study.reduce.model_copy(update={"flank_edges_per_lobe": 12, "patch_half_width_mm": 0.3})
    study = study.model_copy(update={"reduce": coarse})
    disk = elastic.elastic_disk(study)
    assert disk.sectors == 79
    whole = replace(disk, sectors=1)
    for crank in (360 / 31, 360 * 17 / 31):
        patches = elastic.disk_patches(study, disk, assembly.reducer(study.design, crank))
        exact = whole.compliance(patches).matrix
        np.testing.assert_allclose(disk.compliance(patches).matrix, exact, rtol=0, atol=1e-9 * exact.max())


def test_reciprocity_of_the_field_and_the_condensed_matrix():
    """Betti: a force on one patch moves every other as a force there moves it, read off the fields of the sectors."""
    body = body_of(EVEN)
    patches = patches_of(body, EVEN, 0.37)
    loads, matrix = body.loads(patches), body.compliance(patches).matrix
    fields = body.displacement(loads.toarray())
    np.testing.assert_allclose(loads.T @ fields, matrix, rtol=0, atol=1e-10 * np.abs(matrix).max())
    np.testing.assert_allclose(body.reference.T @ fields, 0, atol=1e-10 * np.abs(fields).max())


def rim_displacement(order, inner, outer, kappa):
    """2 G u_r / cos(n theta) at the rim of an annulus under the outward traction cos(n theta) there (Michell).

    Barber, Elasticity (2010), tables 8.1 and 9.1: rows are the radial and shear traction at the rim and at the bore. At
    n = 1 a uniform traction of the bore bears the load, and the bore's mean displacement is taken off.
    """
    n, radii = order, np.array([outer, inner])
    if n == 0:  # r^2 and ln r
        a, b = np.linalg.solve([[2, 1 / outer**2], [2, 1 / inner**2]], [1, 0])
        return a * (kappa - 1) * outer - b / outer
    if n == 1:  # r^3 cos, r theta sin, r ln r cos, cos / r and the traction of the bore
        r = radii
        radial, shear = [2 * r, 2 / r, 1 / r, -2 / r**3], [2 * r, 0 * r, 1 / r, -2 / r**3]
        system = np.zeros((5, 5))
        system[[0, 2], :4], system[[1, 3], :4] = np.transpose(radial), np.transpose(shear)
        system[2, 4], system[3, 4] = 1, -1
        system[4, 1:3] = kappa - 1, kappa + 1  # single-valued
        coefficients = np.linalg.solve(system, [1, 0, 0, 0, 0])[:4]
        radial_terms = [
            (kappa - 2) * r**2,
            ((kappa + 1) * np.log(r) - 1) / 2,
            ((kappa - 1) * np.log(r) - 1) / 2,
            1 / r**2,
        ]
        tangential_terms = [
            (kappa + 2) * r**2,
            (-(kappa + 1) * np.log(r) - 1) / 2,
            (-(kappa - 1) * np.log(r) - 1) / 2,
            1 / r**2,
        ]
        radial_terms, tangential_terms = coefficients @ radial_terms, coefficients @ tangential_terms
        return radial_terms[0] - (radial_terms[1] - tangential_terms[1]) / 2
    r = radii / outer  # r^n, r^-n, r^(n + 2), r^(2 - n), those that fall outwards as shares of their size at the bore
    fall = (inner / radii) ** n
    radial = [n * (1 - n) * r ** (n - 2), -n * (n + 1) * fall / r**2, (n + 2 - n * n) * r**n, (2 - n - n * n) * fall]
    shear = [(n - 1) * r ** (n - 2), -(n + 1) * fall / r**2, (n + 1) * r**n, (1 - n) * fall]
    coefficients = np.linalg.solve(np.transpose(np.hstack([radial, n * np.array(shear)])), [1, 0, 0, 0])
    return outer * coefficients @ [-n, n * fall[0], kappa - 1 - n, (kappa - 1 + n) * fall[0]]


@pytest.mark.parametrize(("stress", "kappa"), [("plane_stress", (3 - NU) / (1 + NU)), ("plane_strain", 3 - 4 * NU)])
def test_annulus_under_forces_on_its_rim_meets_michells_series(stress, kappa):
    """Elliptical pressures on the rim, borne by the bore: harmonic by harmonic, without a mesh."""
    inner, outer, width, n_sectors, n_edges = 2.0, 5.0, 0.05, 9, 1620
    rim = outer * np.exp(2j * np.pi * np.arange(n_edges) / n_edges)
    mesh = lobed_disk_mesh(rim, n_sectors, inner, growth=0.3, largest_edge=0.4)
    body = elastic_body(mesh, E, NU, THICKNESS, stress, "bore", n_sectors)
    angle = np.array([0.0, 0.2, 0.9, 1.7, 3.0, 4.4])
    compliance = body.compliance(
        boundary_patches(mesh, "flank", outer * np.exp(1j * angle), -np.exp(1j * angle), width)
    )
    orders = np.arange(1, 1500)
    by_order = np.array([rim_displacement(n, inner, outer, kappa) for n in orders])
    pressure = 2 * j1(orders * width / outer) / (orders * width / outer)  # of the elliptical one, by order
    kernel = np.cos(orders * (angle[:, None] - angle)[..., None])
    series = rim_displacement(0, inner, outer, kappa) / 2 + kernel @ (by_order * pressure**2)
    exact = series / (np.pi * outer * THICKNESS) * (1 + NU) / E
    miss = np.abs(compliance.matrix - exact) / exact.max()
    assert miss.max() < 2e-3  # under a patch the force, of one direction, is not quite radial: 0.06 of width / radius
    assert miss[~np.eye(len(angle), dtype=bool)].max() < 2e-4


def test_a_mesh_that_does_not_repeat_is_refused():
    body = body_of(ODD)
    patches = patches_of(body, ODD, 0.0)
    with pytest.raises(ValueError, match="must be 3 or more|equal sectors"):
        replace(body, sectors=7).compliance(patches)
    points = body.mesh.p.copy()
    points[:, -1] *= 1 + 1e-6
    bent = MeshTri(points, body.mesh.t, sort_t=False).with_boundaries(body.mesh.boundaries)
    with pytest.raises(ValueError, match="does not repeat in 11 sectors"):
        elastic_body(bent, E, NU, THICKNESS, "plane_stress", "bore", 11).compliance(patches)
