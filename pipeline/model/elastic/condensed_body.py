"""Elastic bodies in two dimensions: quadratic triangles, factorised once, compliance between patches.

A body is held by the rigid motion fitted to one of its boundaries (the disk: mean displacement and mean
rotation of its bore), which carries the reaction to whatever loads it. Units N, mm, MPa.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csc_array, csr_array, diags_array
from scipy.sparse.linalg import splu
from skfem import Basis, ElementTriP2, ElementVector, FacetBasis, LinearForm, MeshTri
from skfem.models.elasticity import lame_parameters, linear_elasticity, plane_stress

from pipeline.model.elastic.cyclic_symmetry import CyclicBody, SectorNodes
from pipeline.model.elastic.polygon import Index
from pipeline.model.elastic.pressure_patches import Patches
from pipeline.model.geometry.cycloid_profile import Complex, Real

Stress = Literal["plane_stress", "plane_strain"]
ELEMENT = ElementVector(ElementTriP2())
COLUMNS_AT_ONCE = 4  # right-hand sides a solve: more fall out of the cache and take up to three times as long
ASYMMETRY_LIMIT = 1e-10  # of a compliance, relative to its largest entry; a sound solve leaves 1e-12


@dataclass(frozen=True)
class Compliance:
    """Elastic compliance between the patches of one body.

    Attributes
    ----------
    matrix
        (n_patches, n_patches) [mm/N], symmetric: C_ij is the pressure-weighted mean displacement of patch i,
        along its direction, for a unit force on patch j.
    asymmetry
        Largest |C_ij - C_ji| before the matrix was made symmetric, relative to the largest entry.
    """

    matrix: Real
    asymmetry: float


@dataclass(frozen=True)
class ElasticBody:
    """A meshed linear elastic body of constant thickness, factorised.

    Attributes
    ----------
    mesh, youngs_modulus, poisson_ratio, thickness, stress
        Straight triangles [mm], E [MPa], nu, t [mm], and ``plane_stress`` or ``plane_strain``.
    nodes
        Of the quadratic triangles (n_nodes,) complex [mm]: the mesh's vertices, then its edges' midpoints.
    triangles
        Nodes of every triangle (n_triangles, 6): corners, then the midpoints of edges 01, 12, 20.
    sectors
        Number of equal sectors about the origin, whose triangles follow each other in ``mesh``; 1 has no symmetry.
    freedoms
        Numbers of the two displacements of each node in a load or displacement vector (n_nodes, 2).
    rigid_motions
        Displacements of the unit motions x, y [mm/mm] and rotation about the origin [mm/rad] (n_freedoms, 3).
    reference
        (n_freedoms, 3): its transpose times a displacement gives the rigid motion that fits the reference
        boundary's displacement in the mean square; its columns are the reactions to a unit resultant.
    """

    mesh: MeshTri
    youngs_modulus: float
    poisson_ratio: float
    thickness: float
    stress: Stress
    sectors: int
    nodes: Complex
    triangles: Index
    freedoms: Index
    rigid_motions: Real
    reference: Real

    @cached_property
    def stiffness(self) -> csc_array:
        """Stiffness matrix (n_freedoms, n_freedoms) [N/mm], singular: the body is free in it."""
        return self._assembled(self.mesh.t.shape[1])

    @cached_property
    def solve(self) -> Callable[[Real], Real]:
        """Displacement of loads that are in balance, in any rigid position: (n_freedoms, k) to (n_freedoms, k)."""
        if self.sectors > 1:
            return self._cyclic.displacement
        return _factorised(self.stiffness, self.nodes, self.freedoms)

    @cached_property
    def _cyclic(self) -> CyclicBody:
        sectors = SectorNodes.of(self.nodes, self.triangles, self.sectors)
        first_sector = self._assembled(self.mesh.t.shape[1] // self.sectors)
        return CyclicBody.of(first_sector, sectors, self.freedoms, self.reference)

    def _assembled(self, n_triangles: int) -> csc_array:
        """Stiffness of the first ``n_triangles``.

        Source
        ------
        skfem.models.elasticity; Zienkiewicz and Taylor, The Finite Element Method (2000) vol. 1, ch. 4.
        """
        basis = Basis(self.mesh, ELEMENT, elements=np.arange(n_triangles), intorder=2)  # exact: strains are linear
        lame = plane_stress if self.stress == "plane_stress" else lame_parameters
        form = linear_elasticity(*lame(self.youngs_modulus, self.poisson_ratio))
        return csc_array(self.thickness * form.assemble(basis))

    def loads(self, patches: Patches) -> csc_array:
        """Consistent loads of unit forces on the patches (n_freedoms, n_patches), in N per N."""
        shape = _quadratic_shapes(patches.barycentric) * patches.weights[:, None]
        freedom = self.freedoms[self.triangles[patches.triangles]]
        components = np.stack([patches.direction.real, patches.direction.imag], axis=-1)
        values = shape[..., None] * components[:, None, None, :]
        column = np.broadcast_to(np.arange(len(patches))[:, None, None, None], values.shape)
        entries = (values.ravel(), (freedom.ravel(), column.ravel()))
        return csc_array(entries, shape=(self.freedoms.size, len(patches)))

    def displacement(self, loads: Real) -> Real:
        """Displacement for any loads [N], the reference boundary held in the mean (n_freedoms, k) [mm]."""
        balanced = loads - self.reference @ (self.rigid_motions.T @ loads)
        displacement = self.solve(balanced)
        return displacement - self.rigid_motions @ (self.reference.T @ displacement)

    def nodal_displacement(self, patches: Patches, forces: ArrayLike) -> Complex:
        """Displacement of every node (n_nodes,) complex [mm] under the ``forces`` (n_patches,) [N] on the patches."""
        displacement = self.displacement((self.loads(patches) @ np.asarray(forces, float))[:, None])[:, 0]
        return displacement[self.freedoms[:, 0]] + 1j * displacement[self.freedoms[:, 1]]

    def compliance(self, patches: Patches) -> Compliance:
        """Compliance between the patches, the reference boundary held in the mean.

        Raises
        ------
        ArithmeticError
            The matrix is not symmetric before it is made so: the factorisation is not sound.
        """
        loads = self.loads(patches)
        raw = self._cyclic.compliance(loads) if self.sectors > 1 else self._direct_compliance(loads)
        return _sound(raw)

    def turned_compliance(self, patches: Patches, turning: Index) -> Real:
        """Compliance (n_sectors, n_patches, n_patches) [mm/N], some patches turned back by 0, 1, ... sectors.

        Of a body of equal sectors; ``turning`` are the numbers of the patches that turn.
        """
        matrices = self._cyclic.turned_compliance(self.loads(patches), turning)
        return np.array([_sound(matrix).matrix for matrix in matrices])

    def _direct_compliance(self, loads: csc_array) -> Real:
        resultant = (loads.T @ self.rigid_motions).T
        rows = np.union1d(loads.indices, np.flatnonzero(np.any(self.reference != 0, axis=1)))
        patch_loads, reference, motions = csr_array(loads)[rows], self.reference[rows], self.rigid_motions[rows]

        def columns(start: int) -> Real:
            """Displacements of the patches under the loads from ``start`` on, formed on the loaded freedoms alone."""
            part = slice(start, start + COLUMNS_AT_ONCE)
            balanced = np.zeros((loads.shape[0], resultant[:, part].shape[1]), order="F")
            balanced[rows] = patch_loads[:, part].toarray() - reference @ resultant[:, part]
            displacement = self.solve(balanced)[rows]
            return patch_loads.T @ (displacement - motions @ (reference.T @ displacement))

        return np.hstack([columns(start) for start in range(0, loads.shape[1], COLUMNS_AT_ONCE)])


def _sound(raw: Real) -> Compliance:
    """A computed compliance, made symmetric."""
    asymmetry = float(np.abs(raw - raw.T).max() / np.abs(raw).max())
    if not asymmetry < ASYMMETRY_LIMIT:
        raise ArithmeticError(f"compliance asymmetric by {asymmetry:.2g} of its largest entry; the mesh is unsound")
    return Compliance((raw + raw.T) / 2, asymmetry)


def elastic_body(
    mesh: MeshTri,
    youngs_modulus: float,
    poisson_ratio: float,
    thickness: float,
    stress: Stress,
    reference: str,
    sectors: int = 1,
) -> ElasticBody:
    """A body of quadratic (P2) triangles, assembled and factorised when it is first condensed.

    Parameters
    ----------
    mesh
        Straight triangles [mm].
    youngs_modulus, poisson_ratio, thickness, stress
        E [MPa], nu [-], t [mm], ``plane_stress`` or ``plane_strain``.
    reference
        Name of the boundary whose mean displacement and rotation are held.
    sectors
        Number of equal sectors of ``lobed_disk_mesh``; 1 makes no use of a symmetry.
    """
    reference_basis = FacetBasis(mesh, ELEMENT, facets=mesh.boundaries[reference])
    freedoms = np.hstack([reference_basis.nodal_dofs, reference_basis.facet_dofs]).T
    vertices = mesh.p[0] + 1j * mesh.p[1]
    nodes = np.concatenate([vertices, vertices[mesh.facets].mean(axis=0)])
    rigid_motions = _rigid_motions(nodes, freedoms)
    return ElasticBody(
        mesh=mesh,
        youngs_modulus=youngs_modulus,
        poisson_ratio=poisson_ratio,
        thickness=thickness,
        stress=stress,
        sectors=sectors,
        nodes=nodes,
        triangles=np.vstack([mesh.t, mesh.nvertices + mesh.t2f]).T,
        freedoms=freedoms,
        rigid_motions=rigid_motions,
        reference=_rigid_fit(reference_basis, rigid_motions),
    )


def _rigid_motions(nodes: Complex, freedoms: Index) -> Real:
    motions = np.zeros((freedoms.size, 3))
    motions[freedoms[:, 0], 0] = 1
    motions[freedoms[:, 1], 1] = 1
    motions[freedoms[:, 0], 2] = -nodes.imag
    motions[freedoms[:, 1], 2] = nodes.real
    return motions


def _rigid_fit(boundary: FacetBasis, rigid_motions: Real) -> Real:
    """Functionals of a displacement: the rigid motion that fits it on the boundary in the mean square."""
    uniform = [
        LinearForm(lambda v, w: v[0]).assemble(boundary),
        LinearForm(lambda v, w: v[1]).assemble(boundary),
        LinearForm(lambda v, w: w.x[0] * v[1] - w.x[1] * v[0]).assemble(boundary),
    ]
    tractions = np.stack(uniform, axis=-1)
    return tractions @ np.linalg.inv(tractions.T @ rigid_motions)


def _factorised(stiffness: csc_array, nodes: Complex, freedoms: Index) -> Callable[[Real], Real]:
    """Solver of balanced loads: three statically determinate freedoms are clamped, so they carry nothing."""
    corner = int(np.argmax(np.abs(nodes)))
    second = int(np.argmax(np.abs(nodes - nodes[corner])))
    edge_normal = 1j * (nodes[second] - nodes[corner])
    clamped = [*freedoms[corner], freedoms[second, int(abs(edge_normal.imag) > abs(edge_normal.real))]]
    free = np.ones(freedoms.size)
    free[clamped] = 0
    supported = csc_array(
        diags_array(free) @ stiffness @ diags_array(free) + diags_array((1 - free) * stiffness.diagonal())
    )
    factors = splu(supported, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})

    def solve(loads: Real) -> Real:
        held_back = np.array(loads, order="F")
        held_back[clamped] = 0
        return factors.solve(held_back)

    return solve


def _quadratic_shapes(barycentric: Real) -> Real:
    """Shape functions of the quadratic triangle at barycentric coordinates (..., 3): (..., 6)."""
    following = np.roll(barycentric, -1, axis=-1)
    return np.concatenate([barycentric * (2 * barycentric - 1), 4 * barycentric * following], axis=-1)
