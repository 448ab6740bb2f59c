"""The condensed contact: independence of mesh and patch, symmetry, energy, scales.

Exact solutions and observed orders of the bodies are checks of ``make verify``, which ``test_verify.py`` runs.
"""

import numpy as np
import pytest

from pipeline.model.elastic.condensed_body import elastic_body
from pipeline.model.elastic.disk_mesh import flank_nodes, lobed_disk_mesh
from pipeline.model.elastic.pressure_patches import boundary_patches, joined_patches, line_patches
from pipeline.model.geometry.cycloid_profile import CycloidProfile

E, NU = 206e3, 0.3
SMALL = CycloidProfile(pins=12, pin_circle_radius=10.0, pin_radius=1.0, eccentricity=0.55)


def disk_mesh(edges=24, growth=0.35, largest=0.8, bore=2.5):
    return lobed_disk_mesh(flank_nodes(SMALL, edges), SMALL.lobes, bore, growth, largest)


def pin_patches(mesh, width):
    psi = 2 * np.pi * (np.arange(SMALL.pins) + 0.37) / SMALL.pins
    return boundary_patches(mesh, "flank", SMALL.flank(psi), SMALL.normal(psi), width)


@pytest.fixture(scope="module")
def disk():
    return elastic_body(disk_mesh(edges=48), E, NU, 2.0, "plane_stress", "bore")


@pytest.mark.long
def test_contact_compliance_does_not_depend_on_mesh_and_patch(disk):
    unit = 2 / (np.pi * E * 2.0)
    edge = np.abs(np.diff(flank_nodes(SMALL, 48)[:2]))[0]
    width = 2 * edge
    base = disk.compliance(pin_patches(disk.mesh, width)).matrix
    fine = elastic_body(disk_mesh(edges=96, growth=0.25, largest=0.5), E, NU, 2.0, "plane_stress", "bore")
    for narrower in (1, 2):
        variant = fine.compliance(pin_patches(fine.mesh, width / narrower)).matrix
        shift = np.diagonal(variant - base) - unit * np.log(narrower)
        assert np.abs(shift).max() < 0.02 * unit
        off_diagonal = (variant - base)[~np.eye(len(base), dtype=bool)]
        assert np.abs(off_diagonal).max() < 0.005 * np.abs(base).max()


def test_compliance_is_symmetric_positive_and_held_at_the_bore(disk):
    inner_patches = line_patches(disk.mesh, [4.5j, 5 - 1j], [1, 1j], [1j, 1], 0.5)
    patches = joined_patches(pin_patches(disk.mesh, 0.2), inner_patches)
    compliance = disk.compliance(patches)
    assert compliance.asymmetry < 1e-10
    np.testing.assert_array_equal(compliance.matrix, compliance.matrix.T)
    assert np.linalg.eigvalsh(compliance.matrix).min() > 0
    forces = np.linspace(-50, 100, len(patches))
    displacement = disk.nodal_displacement(patches, forces)
    bore = np.abs(np.abs(disk.nodes) - 2.5) < 5e-3
    assert np.abs(np.mean(displacement[bore])) < 1e-3 * np.abs(displacement).max()
    vector = np.zeros(disk.freedoms.size)
    vector[disk.freedoms[:, 0]], vector[disk.freedoms[:, 1]] = displacement.real, displacement.imag
    np.testing.assert_allclose(disk.reference.T @ vector, 0, atol=1e-15)
    np.testing.assert_allclose(disk.loads(patches).T @ vector, compliance.matrix @ forces, rtol=1e-8)
    energy = vector @ (disk.stiffness @ vector)
    assert energy == pytest.approx(forces @ compliance.matrix @ forces, rel=1e-9)


def test_plane_strain_is_plane_stress_with_the_equivalent_constants(disk):
    mesh = disk.mesh
    strain = elastic_body(mesh, E, NU, 2.0, "plane_strain", "bore").compliance(pin_patches(mesh, 0.2)).matrix
    stress = elastic_body(mesh, E / (1 - NU**2), NU / (1 - NU), 2.0, "plane_stress", "bore")
    np.testing.assert_allclose(strain, stress.compliance(pin_patches(mesh, 0.2)).matrix, rtol=1e-9, atol=1e-18)


def test_compliance_falls_with_thickness_and_modulus(disk):
    variant = elastic_body(disk.mesh, 2 * E, NU, 6.0, "plane_stress", "bore")
    np.testing.assert_allclose(
        variant.compliance(pin_patches(disk.mesh, 0.2)).matrix,
        disk.compliance(pin_patches(disk.mesh, 0.2)).matrix / 6,
        rtol=1e-9,
        atol=1e-18,
    )
