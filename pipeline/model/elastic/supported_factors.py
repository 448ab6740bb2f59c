"""Factors of a free body's stiffness, three statically determinate freedoms clamped: they carry no balanced load."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import SuperLU, splu

from pipeline.arrays import Complex, Index, Real, Whole
from pipeline.model.compiled import entry

_Columns = tuple[NDArray[np.int32] | Whole, NDArray[np.int32] | Whole, Real]
"""A sparse matrix by its columns: where each starts, the row of each entry, and the entries."""


@entry
def _eliminate(lower: _Columns, loads: _Columns, rows: Whole, values: Real, ends: Whole) -> int:
    """Solve L y = load for sparse loads; the entries of y in the order of the columns, as many as there is room for.

    A load at a few freedoms touches only what is eliminated after them: on a mesh of 10^5 nodes 1 % of the rows.
    """
    starts, row_of, factor = lower
    starts_of_load, row_of_load, share = loads
    n, count = starts.shape[0] - 1, 0
    row_values = np.zeros(n)
    for k in range(starts_of_load.shape[0] - 1):
        first_row = n
        for p in range(starts_of_load[k], starts_of_load[k + 1]):
            row_values[row_of_load[p]] = share[p]
            first_row = min(first_row, row_of_load[p])
        for j in range(first_row, n):
            value = row_values[j]
            if value == 0.0:
                continue
            for p in range(starts[j], starts[j + 1]):
                row_values[row_of[p]] -= factor[p] * value
            row_values[j] = 0.0
            if count < rows.shape[0]:
                rows[count], values[count] = j, value
            count += 1
        ends[k + 1] = count
    return count


def symmetric_factors(matrix: csc_array) -> SuperLU:
    """Factors of a symmetric positive definite matrix (n, n)."""
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


@dataclass(frozen=True)
class SupportedFactors:
    """Factors L D L^T of a stiffness (n_freedoms, n_freedoms) [N/mm] in an order of its own, some freedoms clamped."""

    factors: SuperLU
    clamped_freedoms: Index

    @classmethod
    def from_stiffness(cls, stiffness: csc_array, nodes: Complex, freedoms: Index) -> "SupportedFactors":
        """Clamp the two freedoms of the outermost of the ``nodes`` (n_nodes,) [mm], and of the farthest from it one.

        Parameters
        ----------
        freedoms
            Numbers of the two displacements of each node (n_nodes, 2).
        """
        corner = int(np.argmax(np.abs(nodes)))
        second = int(np.argmax(np.abs(nodes - nodes[corner])))
        edge_normal = 1j * (nodes[second] - nodes[corner])
        clamped_freedoms = np.array(
            [*freedoms[corner], freedoms[second, int(abs(edge_normal.imag) > abs(edge_normal.real))]]
        )
        free_diagonal = np.ones(freedoms.size)
        free_diagonal[clamped_freedoms] = 0
        supported_stiffness = csc_array(
            diags_array(free_diagonal) @ stiffness @ diags_array(free_diagonal)
            + diags_array((1 - free_diagonal) * stiffness.diagonal())
        )
        return cls(symmetric_factors(supported_stiffness), clamped_freedoms)

    def solve(self, loads: Real) -> Real:
        """Displacement [mm] of balanced loads (n_freedoms, k) [N], in the position in which the body is clamped."""
        held_back = np.array(loads, order="F")
        held_back[self.clamped_freedoms] = 0
        solutions: Real = self.factors.solve(held_back)
        return solutions

    @cached_property
    def _lower(self) -> tuple[csc_array, Real]:
        """Factor L without its diagonal of ones, and D (n_freedoms,) [N/mm].

        Raises
        ------
        ArithmeticError
            The factors are not symmetric: a pivot was taken off the diagonal.
        """
        lower, pivots = self.factors.L, self.factors.U.diagonal()
        if not np.array_equal(self.factors.perm_r, self.factors.perm_c) or not np.all(pivots > 0):
            raise ArithmeticError("the stiffness has no symmetric factors; the mesh is unsound")
        lower.setdiag(0.0)
        return lower, pivots

    def works(self, loads: csc_array) -> Real:
        """Work of each load (n_freedoms, k) [N] on the displacement by each other, clamped: (k, k) [N mm].

        Notes
        -----
        The loads are eliminated alone, y = L^-1 load, and work y^T D^-1 y on each other. What the clamps take of loads
        out of balance is left out: only balanced sums of the works mean anything.
        """
        lower, pivots = self._lower
        entries = loads.tocoo()
        freedom, load = entries.coords
        is_free = ~np.isin(freedom, self.clamped_freedoms)
        ordered_loads = csc_array(
            (entries.data[is_free], (self.factors.perm_r[freedom[is_free]], load[is_free])), shape=loads.shape
        )
        factor_columns, load_columns = (
            (matrix.indptr, matrix.indices, matrix.data) for matrix in (lower, ordered_loads)
        )
        room, ends = 4096 * loads.shape[1], np.zeros(loads.shape[1] + 1, np.int64)
        while True:
            rows, values = np.empty(room, np.int64), np.empty(room)
            count = _eliminate(factor_columns, load_columns, rows, values, ends)
            if count <= room:
                break
            room = count
        eliminated_loads = csc_array((values[:count], rows[:count], ends), shape=loads.shape)
        scaled_loads = diags_array(1 / np.sqrt(pivots)) @ eliminated_loads
        return np.asarray((scaled_loads.T @ scaled_loads).toarray())
