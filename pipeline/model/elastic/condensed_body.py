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
from scipy.sparse import csc_array, hstack
from skfem import Basis, ElementTriP2, ElementVector, FacetBasis, LinearForm, MeshTri
from skfem.models.elasticity import lame_parameters, linear_elasticity, plane_stress

from pipeline.arrays import Complex, Index, Real
from pipeline.model.elastic.cyclic_symmetry import CyclicBody, SectorNodes
from pipeline.model.elastic.polygon import points_of
from pipeline.model.elastic.pressure_patches import Patches
from pipeline.model.elastic.supported_factors import SupportedFactors

Stress = Literal["plane_stress", "plane_strain"]
ELEMENT = ElementVector(ElementTriP2())
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
        return self._assemble_stiffness(self.mesh.t.shape[1])

    @cached_property
    def solve(self) -> Callable[[Real], Real]:
        """Displacement of loads that are in balance, in any rigid position: (n_freedoms, k) to (n_freedoms, k)."""
        if self.sectors > 1:
            return self._cyclic.displacement
        return self._factors.solve

    @cached_property
    def _factors(self) -> SupportedFactors:
        return SupportedFactors.from_stiffness(self.stiffness, self.nodes, self.freedoms)

    @cached_property
    def _cyclic(self) -> CyclicBody:
        sectors = SectorNodes.from_triangles(self.nodes, self.triangles, self.sectors)
        first_sector = self._assemble_stiffness(self.mesh.t.shape[1] // self.sectors)
        return CyclicBody.from_stiffness(first_sector, sectors, self.freedoms, self.reference)

    def _assemble_stiffness(self, n_triangles: int) -> csc_array:
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
        balanced_loads = loads - self.reference @ (self.rigid_motions.T @ loads)
        displacement = self.solve(balanced_loads)
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
        """Work of each load on the displacement by each other; the first column by a whole solve, for comparison."""
        reaction = np.vstack([np.eye(loads.shape[1]), -(loads.T @ self.rigid_motions).T])
        works = self._factors.works(csc_array(hstack([loads, csc_array(self.reference)])))
        compliance: Real = reaction.T @ works @ reaction
        compliance[:, 0] = loads.T @ self.displacement(loads[:, [0]].toarray())[:, 0]
        return compliance


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
    vertices = points_of(mesh.p)
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
    tractions: Real = np.stack(uniform, axis=-1)
    return tractions @ np.linalg.inv(tractions.T @ rigid_motions)


def _quadratic_shapes(barycentric: Real) -> Real:
    """Shape functions of the quadratic triangle at barycentric coordinates (..., 3): (..., 6)."""
    following = np.roll(barycentric, -1, axis=-1)
    return np.concatenate([barycentric * (2 * barycentric - 1), 4 * barycentric * following], axis=-1)
