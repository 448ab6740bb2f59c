"""Check of the disk's compliance: symmetry, patch loads, and independence of mesh and patch width at every pin."""

from collections.abc import Iterator

import numpy as np

from pipeline import elastic
from pipeline.arrays import Real
from pipeline.checks.specimen import Specimen
from pipeline.checks.verify.findings import Finding, at_least, largest_difference, vanishing
from pipeline.config import Study
from pipeline.model.contact.laws import Material
from pipeline.model.elastic.pressure_patches import boundary_patches

FINER = np.sqrt(2)
"""Edges are shorter by this factor everywhere in each refinement: twice the triangles."""


def _refined_study(study: Study, factor: float) -> Study:
    reduce = study.reduce
    return study.model_copy(
        update={
            "reduce": reduce.model_copy(
                update={
                    "flank_edges_per_lobe": round(factor * reduce.flank_edges_per_lobe),
                    "growth": reduce.growth / factor,
                    "largest_edge_mm": reduce.largest_edge_mm / factor,
                }
            )
        }
    )


def _pin_compliances(specimen: Specimen, factor: float, widths: list[float]) -> list[Real]:
    """Compliance between the pins on a refined mesh, for patches of every half width [mm]."""
    disk = elastic.elastic_disk(_refined_study(specimen.study, factor))
    pins = specimen.reducer.pins
    centre = specimen.profile.eccentricity * np.exp(1j * specimen.reducer.crank)
    turn = np.exp(1j * specimen.reducer.crank / specimen.profile.lobes)
    point, normal = (pins.point - centre) * turn, pins.normal * turn
    return [disk.compliance(boundary_patches(disk.mesh, "flank", point, normal, width)).matrix for width in widths]


def _patch_loads(specimen: Specimen) -> tuple[Real, Real]:
    """Resultant (n, 3) of the unit loads of every patch: as assembled, and as the contact's point and normal say."""
    patches = specimen.patches
    load_resultants = specimen.disk.loads(patches).T @ specimen.disk.rigid_motions
    jacobian = specimen.reducer.contact_jacobian[specimen.disk_rows]
    directions, arms = jacobian[:, :2].T, jacobian[:, 2]
    turn = np.exp(1j * specimen.reducer.crank / specimen.profile.lobes)
    force = -(directions[0] + 1j * directions[1]) * turn
    return load_resultants, np.stack([force.real, force.imag, -arms], axis=-1)


def check_disk_compliance(specimen: Specimen) -> Iterator[Finding]:
    """Disk compliance: symmetry, patch integrals, mesh and patch independence."""
    study, compliance = specimen.study, specimen.disk_compliance
    load_resultants, resultants = _patch_loads(specimen)
    yield largest_difference("force of every patch per unit force", resultants[:, :2], load_resultants[:, :2], 1e-3)
    largest_arm = np.abs(resultants[:, 2]).max()
    yield largest_difference(
        "moment of every patch, over the largest arm", resultants[:, 2], load_resultants[:, 2], 1e-3, largest_arm
    )
    yield vanishing("asymmetry before symmetrising, over the largest entry", compliance.asymmetry, 1e-10)
    yield at_least("least eigenvalue of the compliance [mm/N]", 0.0, np.linalg.eigvalsh(compliance.matrix))

    steel = study.design.materials[study.design.disk.material]
    material = Material(steel.youngs_modulus_MPa, steel.poisson_ratio, study.design.disk.stress)
    unit = 2 / (np.pi * material.modulus * study.design.disk.thickness_mm)
    n, width = specimen.reducer.n_pins, study.reduce.patch_half_width_mm
    off_diagonal = ~np.eye(n, dtype=bool)
    base = compliance.matrix[:n, :n]
    (refined_compliance,) = _pin_compliances(specimen, FINER, [width])
    twice_refined, halved_patch_compliance = _pin_compliances(specimen, FINER**2, [width, width / 2])
    for name, finer, narrowing in (
        ("mesh refined once", refined_compliance, 1.0),
        ("mesh refined twice", twice_refined, 1.0),
        ("mesh refined twice, patch halved", halved_patch_compliance, 2.0),
    ):
        yield largest_difference(
            f"C_ii + unit ln(w) at every pin, {name}, over unit = 2/(pi E' t)",
            np.diag(base) / unit,
            np.diag(finer) / unit - np.log(narrowing),
            0.02,
        )
        yield largest_difference(
            f"off-diagonals of the pins, {name}, over the largest",
            base[off_diagonal],
            finer[off_diagonal],
            5e-3,
            np.abs(base[off_diagonal]).max(),
        )
