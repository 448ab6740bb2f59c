"""Elastic bodies in two dimensions: quadratic triangles, one factorisation, compliance between patches.

A body is held by the rigid motion fitted to one of its boundaries (the disk: mean displacement and mean
rotation of its bore), which carries the reaction to whatever loads it. Units N, mm, MPa.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csc_array, csr_array, diags_array
from scipy.sparse.linalg import splu
from skfem import Basis, ElementTriP2, ElementVector, FacetBasis, LinearForm, MeshTri
from skfem.models.elasticity import lame_parameters, linear_elasticity, plane_stress

from pipeline.model.elastic.polygon import Index
from pipeline.model.elastic.pressure_patches import Patches
from pipeline.model.geometry.cycloid_profile import Complex, Real

Stress = Literal["plane_stress", "plane_strain"]
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
    freedoms
        Numbers of the two displacements of each node in a load or displacement vector (n_nodes, 2).
    stiffness
        Stiffness matrix (n_freedoms, n_freedoms) [N/mm], singular: the body is free in it.
    rigid_motions
        Displacements of the unit motions x, y [mm/mm] and rotation about the origin [mm/rad] (n_freedoms, 3).
    reference
        (n_freedoms, 3): its transpose times a displacement gives the rigid motion that fits the reference
        boundary's displacement in the mean square; its columns are the reactions to a unit resultant.
    solve
        Displacement of loads that are in balance, in any rigid position: (n_freedoms, k) to (n_freedoms, k).
    """

    mesh: MeshTri
    youngs_modulus: float
    poisson_ratio: float
    thickness: float
    stress: Stress
    nodes: Complex
    triangles: Index
    freedoms: Index
    stiffness: csc_array
    rigid_motions: Real
    reference: Real
    solve: Callable[[Real], Real]

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
        moved = self.solve(balanced)
        return moved - self.rigid_motions @ (self.reference.T @ moved)

    def nodal_displacement(self, patches: Patches, forces: ArrayLike) -> Complex:
        """Displacement of every node (n_nodes,) complex [mm] under the ``forces`` (n_patches,) [N] on the patches."""
        moved = self.displacement((self.loads(patches) @ np.asarray(forces, float))[:, None])[:, 0]
        return moved[self.freedoms[:, 0]] + 1j * moved[self.freedoms[:, 1]]

    def compliance(self, patches: Patches) -> Compliance:
        """Compliance between the patches, the reference boundary held in the mean.

        Raises
        ------
        ArithmeticError
            The matrix is not symmetric before it is made so: the factorisation is not sound.
        """
        loads = self.loads(patches)
        resultant = (loads.T @ self.rigid_motions).T
        rows = np.union1d(loads.indices, np.flatnonzero(np.any(self.reference != 0, axis=1)))
        near, reference, motions = csr_array(loads)[rows], self.reference[rows], self.rigid_motions[rows]

        def columns(start: int) -> Real:
            """Displacements of the patches under the loads from ``start`` on, formed on the loaded freedoms alone."""
            part = slice(start, start + COLUMNS_AT_ONCE)
            balanced = np.zeros((loads.shape[0], resultant[:, part].shape[1]), order="F")
            balanced[rows] = near[:, part].toarray() - reference @ resultant[:, part]
            moved = self.solve(balanced)[rows]
            return near.T @ (moved - motions @ (reference.T @ moved))

        raw = np.hstack([columns(start) for start in range(0, len(patches), COLUMNS_AT_ONCE)])
        asymmetry = float(np.abs(raw - raw.T).max() / np.abs(raw).max())
        if not asymmetry < ASYMMETRY_LIMIT:
            raise ArithmeticError(f"compliance asymmetric by {asymmetry:.2g} of its largest entry; the mesh is unsound")
        return Compliance((raw + raw.T) / 2, asymmetry)


def elastic_body(
    mesh: MeshTri, youngs_modulus: float, poisson_ratio: float, thickness: float, stress: Stress, reference: str
) -> ElasticBody:
    """Assemble and factorise a body of quadratic (P2) triangles.

    Parameters
    ----------
    mesh
        Straight triangles [mm].
    youngs_modulus, poisson_ratio, thickness, stress
        E [MPa], nu [-], t [mm], ``plane_stress`` or ``plane_strain``.
    reference
        Name of the boundary whose mean displacement and rotation are held.

    Source
    ------
    skfem.models.elasticity; Zienkiewicz and Taylor, The Finite Element Method (2000) vol. 1, ch. 4.
    """
    basis = Basis(mesh, ElementVector(ElementTriP2()), intorder=2)  # exact: strains are linear
    lame = (plane_stress if stress == "plane_stress" else lame_parameters)(youngs_modulus, poisson_ratio)
    stiffness = csc_array(thickness * linear_elasticity(*lame).assemble(basis))
    freedoms = np.hstack([basis.nodal_dofs, basis.facet_dofs]).T
    nodes = basis.doflocs[0, freedoms[:, 0]] + 1j * basis.doflocs[1, freedoms[:, 0]]
    rigid_motions = _rigid_motions(nodes, freedoms)
    held = FacetBasis(mesh, basis.elem, facets=mesh.boundaries[reference])
    return ElasticBody(
        mesh=mesh,
        youngs_modulus=youngs_modulus,
        poisson_ratio=poisson_ratio,
        thickness=thickness,
        stress=stress,
        nodes=nodes,
        triangles=np.vstack([mesh.t, mesh.nvertices + mesh.t2f]).T,
        freedoms=freedoms,
        stiffness=stiffness,
        rigid_motions=rigid_motions,
        reference=_rigid_fit(held, rigid_motions),
        solve=_factorised(stiffness, nodes, freedoms),
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
    first = int(np.argmax(np.abs(nodes)))
    second = int(np.argmax(np.abs(nodes - nodes[first])))
    across = 1j * (nodes[second] - nodes[first])
    clamped = [*freedoms[first], freedoms[second, int(abs(across.imag) > abs(across.real))]]
    free = np.ones(freedoms.size)
    free[clamped] = 0
    held = csc_array(diags_array(free) @ stiffness @ diags_array(free) + diags_array((1 - free) * stiffness.diagonal()))
    factors = splu(held, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})

    def solve(loads: Real) -> Real:
        held_back = np.array(loads, order="F")
        held_back[clamped] = 0
        return factors.solve(held_back)

    return solve


def _quadratic_shapes(barycentric: Real) -> Real:
    """Shape functions of the quadratic triangle at barycentric coordinates (..., 3): (..., 6)."""
    following = np.roll(barycentric, -1, axis=-1)
    return np.concatenate([barycentric * (2 * barycentric - 1), 4 * barycentric * following], axis=-1)
