"""Linear programs that differ in their limits alone, by the dual simplex from one common basis (compiled).

Maximise objective @ x subject to rows @ x <= limits, and to |x[2k:2k+2]| <= radii[k] for centres in discs. Whether a
basis is dual feasible does not depend on the limits: every program starts from the same one, and its answer does not
depend on the others (Lemke, Nav. Res. Logist. Q. 1 (1954) 36). Some ten unknowns and a hundred rows take a few pivots.
A disc is replaced by its tangents at the optima so far (Kelley, J. SIAM 8 (1960) 703): one more row, which enters.
"""

import numpy as np
import scipy  # its functions are slow to import: they are when they are called

from pipeline.arrays import Index, Real, Whole
from pipeline.model.compiled import entry, part
from pipeline.model.geometry.rigid_play.disc_program import CONE_TOLERANCE

FEASIBLE = 1e-10
"""Violation of a limit, in the unit of the limits over that of the rows, that is rounding."""
LEAST_PIVOT = 1e-9
"""Share of the rows' largest entry below which a pivot is rounding."""
MOST_VIOLATED = 20
"""Pivots per unknown in which the most violated row enters; then the first one does, which cannot cycle."""
MOST_TANGENTS = 40
"""Tangents of a disc after which a program is given up; an optimum at the edge of a disc needs some 16."""
MOST_PIVOTS = 200
"""Pivots per unknown after which a program is given up."""


@part
def _exchange(
    rows: Real, entering: int, violation: float, basis: Index, inverse: Real, duals: Real, share: Real, x: Real
) -> bool:
    """Let a violated row into the basis, and ``x`` onto it, for the one whose dual falls to zero first.

    False if no row can leave: the program is infeasible.
    """
    size = rows.shape[0]
    leaving, least = -1, np.inf
    for k in range(size):
        share[k] = 0.0
        for d in range(size):
            share[k] += rows[d, entering] * inverse[d, k]
        if share[k] > LEAST_PIVOT:
            ratio = duals[k] / share[k]
            if ratio < least or (ratio == least and basis[k] < basis[leaving]):
                leaving, least = k, ratio
    if leaving < 0:
        return False
    for k in range(size):
        duals[k] = max(duals[k] - least * share[k], 0.0)
    duals[leaving] = least
    for d in range(size):
        column = inverse[d, leaving] / share[leaving]
        x[d] -= violation * column
        for k in range(size):
            inverse[d, k] -= share[k] * column
        inverse[d, leaving] = column
    basis[leaving] = entering
    return True


@entry
def _solve(
    rows: Real, limits: Real, radii: Real, basis: Index, inverse: Real, duals: Real, points: Real, state: Whole
) -> None:
    """Fill ``points`` (n, n_unknowns) and ``state`` (n,): 0 solved, 1 infeasible, 2 given up.

    ``rows`` (n_unknowns, n_rows) are columns here: the violations of all are found several at once. The last
    ``MOST_TANGENTS`` of each disc are room for its tangents.
    """
    size, discs = rows.shape[0], radii.shape[1]
    n_fixed = rows.shape[1] - MOST_TANGENTS * discs
    own_basis, own_inverse, own_duals, own_rows = basis.copy(), inverse.copy(), duals.copy(), rows.copy()
    share, limit, violations = np.empty(size), np.empty(rows.shape[1]), np.empty(rows.shape[1])
    for s in range(limits.shape[0]):
        own_basis[:], own_inverse[:], own_duals[:] = basis, inverse, duals
        x, n_rows = points[s], n_fixed
        limit[:n_fixed] = limits[s]
        for d in range(size):
            x[d] = 0.0
            for k in range(size):
                x[d] += own_inverse[d, k] * limit[own_basis[k]]
        state[s] = 2
        for pivot in range(MOST_PIVOTS * size):
            entering, worst = -1, FEASIBLE
            for i in range(n_rows):
                violations[i] = -limit[i]
            for d in range(size):
                row, unknown = own_rows[d], x[d]
                for i in range(n_rows):
                    violations[i] += row[i] * unknown
            for i in range(n_rows):
                if violations[i] > worst:
                    entering, worst = i, violations[i]
                    if pivot >= MOST_VIOLATED * size:
                        break
            if entering < 0:
                farthest = -1
                for k in range(discs):
                    overshoot = np.hypot(x[2 * k], x[2 * k + 1]) - radii[s, k]
                    if overshoot > worst + CONE_TOLERANCE * radii[s, k]:
                        farthest, worst = k, overshoot
                if farthest < 0:
                    state[s] = 0
                    break
                if n_rows == rows.shape[1]:
                    break
                reach = worst + radii[s, farthest]
                own_rows[:, n_rows] = 0.0
                for d in range(2 * farthest, 2 * farthest + 2):
                    own_rows[d, n_rows] = x[d] / reach
                entering, limit[n_rows] = n_rows, radii[s, farthest]
                n_rows += 1
            if not _exchange(own_rows, entering, worst, own_basis, own_inverse, own_duals, share, x=x):
                state[s] = 1
                break


def optimal_points(objective: Real, rows: Real, limits: Real, radii: Real) -> tuple[Real, np.ndarray]:
    """Points (n, n_unknowns) that maximise objective @ x, and whether there are any (n,).

    Parameters
    ----------
    rows : (n_rows, n_unknowns), of full rank.
    limits : (n, n_rows) of each program, of the size of some units.
    radii : (n, n_discs) of the discs in which x[2k:2k+2] lie, in the same unit.

    Raises
    ------
    ArithmeticError
        If the programs are unbounded, or one is given up.
    """
    discs, size = radii.shape[1], rows.shape[1]
    scale = np.abs(rows).max(axis=0)
    scale[: 2 * discs] = 1.0
    box = np.repeat(np.eye(size)[: 2 * discs], 2, axis=0)
    box[1::2] *= -1.0
    scaled = np.vstack([rows / scale, box])
    limits = np.hstack([limits, np.repeat(radii, 4, axis=1)])
    basis, duals = _dual_feasible(objective / scale, scaled)
    points, state = np.empty((len(limits), size)), np.empty(len(limits), np.int64)
    inverse = np.linalg.inv(scaled[basis])
    scaled = np.vstack([scaled, np.zeros((MOST_TANGENTS * discs, size))])
    columns = np.ascontiguousarray(scaled.T)
    _solve(
        columns, np.ascontiguousarray(limits), np.ascontiguousarray(radii), basis, inverse, duals, points, state=state
    )
    if np.any(state == 2):
        effort = f"{MOST_PIVOTS} pivots per unknown and {MOST_TANGENTS} tangents of a disc"
        raise ArithmeticError(f"a linear program is not solved within {effort}")
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
