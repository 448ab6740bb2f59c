"""Linear programs that differ in their limits alone, by the dual simplex from one common basis (compiled).

Maximise objective @ x subject to rows @ x <= limits. Whether a basis is dual feasible does not depend on the limits:
every program starts from the same one, and its answer does not depend on the others (Lemke, Nav. Res. Logist. Q. 1
(1954) 36). Some ten unknowns and a hundred rows take a few pivots.
"""

import numpy as np
import scipy  # its functions are slow to import: they are when they are called

from pipeline.model.compiled import entry
from pipeline.model.geometry.cycloid_profile import Index, Real

FEASIBLE = 1e-10
"""Violation of a limit, in the unit of the limits over that of the rows, that is rounding."""
LEAST_PIVOT = 1e-9
"""Share of the rows' largest entry below which a pivot is rounding."""
MOST_VIOLATED = 20
"""Pivots per unknown in which the most violated row enters; then the first one does, which cannot cycle."""
MOST_PIVOTS = 200
"""Pivots per unknown after which a program is given up."""


@entry
def _solve(rows, limits, basis, inverse, duals, points, state):
    """Fill ``points`` (n, n_unknowns) and ``state`` (n,): 0 solved, 1 infeasible, 2 given up."""
    n_rows, size = rows.shape
    own_basis, own_inverse, own_duals = basis.copy(), inverse.copy(), duals.copy()
    share = np.empty(size)
    for s in range(limits.shape[0]):
        own_basis[:], own_inverse[:], own_duals[:] = basis, inverse, duals
        x, limit = points[s], limits[s]
        for d in range(size):
            x[d] = 0.0
            for k in range(size):
                x[d] += own_inverse[d, k] * limit[own_basis[k]]
        state[s] = 2
        for pivot in range(MOST_PIVOTS * size):
            entering, worst = -1, FEASIBLE
            for i in range(n_rows):
                violation = -limit[i]
                for d in range(size):
                    violation += rows[i, d] * x[d]
                if violation > worst:
                    entering, worst = i, violation
                    if pivot >= MOST_VIOLATED * size:
                        break
            if entering < 0:
                state[s] = 0
                break
            leaving, least = -1, np.inf
            for k in range(size):
                share[k] = 0.0
                for d in range(size):
                    share[k] += rows[entering, d] * own_inverse[d, k]
                if share[k] > LEAST_PIVOT:
                    ratio = own_duals[k] / share[k]
                    if ratio < least or (ratio == least and own_basis[k] < own_basis[leaving]):
                        leaving, least = k, ratio
            if leaving < 0:
                state[s] = 1
                break
            for k in range(size):
                own_duals[k] = max(own_duals[k] - least * share[k], 0.0)
            own_duals[leaving] = least
            for d in range(size):
                column = own_inverse[d, leaving] / share[leaving]
                x[d] -= worst * column
                for k in range(size):
                    own_inverse[d, k] -= share[k] * column
                own_inverse[d, leaving] = column
            own_basis[leaving] = entering


def optimal_points(objective: Real, rows: Real, limits: Real) -> tuple[Real, np.ndarray]:
    """Points (n, n_unknowns) that maximise objective @ x, and whether there are any (n,).

    Parameters
    ----------
    rows : (n_rows, n_unknowns), of full rank.
    limits : (n, n_rows) of each program, of the size of some units.

    Raises
    ------
    ArithmeticError
        If the programs are unbounded, or one is given up.
    """
    scale = np.abs(rows).max(axis=0)
    scaled = np.ascontiguousarray(rows / scale)
    basis, duals = _dual_feasible(objective / scale, scaled)
    points, state = np.empty((len(limits), rows.shape[1])), np.empty(len(limits), np.int64)
    _solve(scaled, np.ascontiguousarray(limits), basis, np.linalg.inv(scaled[basis]), duals, points, state)
    if np.any(state == 2):
        raise ArithmeticError(f"a linear program is not solved within {MOST_PIVOTS} pivots per unknown")
    return points / scale, state == 0


def _dual_feasible(objective: Real, rows: Real) -> tuple[Index, Real]:
    """Rows (n_unknowns,) of a basis whose weights >= 0 make the objective, and the weights."""
    weights, misfit = scipy.optimize.nnls(rows.T, objective)
    if misfit > 1e-9 * np.linalg.norm(objective):
        raise ArithmeticError("a linear program is unbounded: no contact stops a motion")
    basis = np.flatnonzero(weights > 0).tolist()
    span = np.linalg.qr(rows[basis].T)[0]
    while len(basis) < rows.shape[1]:  # by the row that is farthest from those chosen
        off_span = rows - rows @ span @ span.T
        farthest = int(np.argmax(np.linalg.norm(off_span, axis=1)))
        basis.append(farthest)
        span = np.linalg.qr(rows[basis].T)[0]
    chosen = np.array(basis)
    return chosen, np.maximum(np.linalg.solve(rows[chosen].T, objective), 0.0)
