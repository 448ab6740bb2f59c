"""A small disk with holes whole in CalculiX, on a mesh of its own, beside the condensed one; and parts of that mesh."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.checks.calculix.program import calculix_program
from pipeline.checks.calculix.quadtree_mesh import Curve, curved_mesh
from pipeline.checks.specimen import Specimen
from pipeline.checks.verify import holes
from pipeline.config import load_study

ROOT = Path(__file__).parents[2]
SMALL = {
    "pins": 12,
    "pin_circle_radius_mm": 10.0,
    "pin_radius_mm": 1.0,
    "eccentricity_mm": 0.55,
    "rated_torque_Nm": 5.0,
}
IN_HOLES = {"pins": 5, "pin_radius_mm": 0.6, "pin_circle_radius_mm": 5.2}
MESH = {
    "flank_edges_per_lobe": 48,
    "patch_half_width_mm": 0.2,
    "roller_patch_half_width_mm": 0.2,
    "growth": 0.35,
    "largest_edge_mm": 0.8,
}


@pytest.fixture(scope="module")
def specimen():
    study = load_study(holes.STUDY, ROOT)
    design = study.design
    parts = {
        "cycloid": design.cycloid.model_copy(update=SMALL),
        "output": design.output.model_copy(update=IN_HOLES),
        "disk": design.disk.model_copy(update={"bore_radius_mm": 2.5}),
    }
    study = study.model_copy(
        update={"design": design.model_copy(update=parts), "reduce": study.reduce.model_copy(update=MESH)}
    )
    return Specimen(study, 1, holes.CRANK_DEG).in_stress("plane_strain")


def test_condensed_holes_and_rim_meet_calculix(specimen):
    if calculix_program() is None:
        pytest.skip("no CalculiX; apt install calculix-ccx")
    pressing = holes.Pressing.from_specimen(specimen)
    assert np.count_nonzero(pressing.forces[-1]) > 3
    answer = holes.calculix_deflections(holes.pressed_disk(specimen, holes.COARSER), pressing.forces)
    computed = pressing.forces @ specimen.disk_compliance.matrix
    result = list(holes.agreement("small", pressing, answer, computed, {"own": 0.04, "elsewhere": 4e-3, "work": 8e-3}))
    assert len(result) == 6
    assert [finding for finding in result if not finding.ok] == []


def test_pressures_of_the_independent_disk_are_in_balance(specimen):
    disk = holes.pressed_disk(specimen, 4.0)
    forces = np.arange(1.0, len(disk.presses) + 1)
    for press, (nodes, share) in zip(disk.presses, disk.shares, strict=True):
        assert share.sum() == pytest.approx(1)
        assert abs(share @ disk.mesh.nodes[nodes] - press.point) < 0.2 * press.half_width
    load = disk.loads(forces)
    assert abs(load.sum()) < 1e-9
    assert abs(np.sum(np.imag(np.conj(disk.mesh.nodes) * load))) < 1e-8


def test_triangles_fill_a_ring_up_to_its_curved_edges():
    def circle(radius):
        return lambda share: radius * np.exp(2j * np.pi * share)

    mesh = curved_mesh(Curve(circle(3.0), 0.5), (Curve(circle(1.0), 0.3),), np.array([1.0 + 0j]), 0.1, 0.4)
    for loop, radius in zip(mesh.loops, (3.0, 1.0), strict=True):
        np.testing.assert_allclose(np.abs(mesh.nodes[loop.corner]), radius)
        np.testing.assert_allclose(np.abs(mesh.nodes[loop.middle]), radius)
    a, b, c = mesh.nodes[mesh.triangles[:, :3]].T
    assert np.all(np.imag(np.conj(b - a) * (c - a)) > 0)
