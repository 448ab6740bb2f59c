"""Linear programs that differ in their limits alone, by the dual simplex from one common basis (compiled).

Maximise objective @ x subject to rows @ x <= limits, and to |x[2k:2k+2]| <= radii[k] for centres in discs. Whether a
basis is dual feasible does not depend on the limits: every program starts from the same one, the optimum of equal
limits, and its answer does not depend on the others (Lemke, Nav. Res. Logist. Q. 1 (1954) 36). Some ten unknowns and a
hundred rows take a dozen pivots. A disc is replaced by its tangents at the optima so far (Kelley, J. SIAM 8 (1960)
703): one more row, which enters.
"""

import numpy as np
import scipy  # its functions are slow to import: they are when they are called

from pipeline.arrays import Index, Real
from pipeline.model.compiled import algebraic_part, entry
from pipeline.model.geometry.rigid_play.disc_program import CONE_TOLERANCE, cut_program

FEASIBLE = 1e-10
"""Violation of a limit, in the unit of the limits over that of the rows, that is rounding."""
LEAST_PIVOT = 1e-9
"""Share of the rows' largest entry below which a pivot is rounding."""
FAR = 1e4
"""Limits of a box beyond all optima, of which those of the programs are 1."""
PERTURBATION, LEAST_WEIGHT = 1e-7, 1e-4
"""Share of the objective's largest part that is added to each, and the share of that below which a weight is 0."""
CANDIDATES = 0.5
"""Share of the largest violation above which rows enter, one after the other, before all rows are looked at again."""
MOST_VIOLATED = 20
"""Pivots per unknown in which the most violated row enters; then the first one does, which cannot cycle."""
MOST_TANGENTS = 40
"""Tangents of a disc after which a program is given up; an optimum at the edge of a disc needs some 16."""
MOST_PIVOTS = 200
"""Pivots per unknown after which a program is given up."""


@algebraic_part
def _exchange(
    row: Real, entering: int, violation: float, basis: Index, inverse: Real, duals: Real, share: Real, x: Real
) -> bool:
    """Let a violated ``row`` into the basis, and ``x`` onto it, for the one whose dual falls to zero first.

    ``inverse`` has the columns of the basis' inverse as rows. False if no row can leave: the program is infeasible.
    """
    size = len(row)
    leaving, least = -1, np.inf
    for k in range(size):
        share[k] = 0.0
        for d in range(size):
            share[k] += row[d] * inverse[k, d]
        if share[k] > LEAST_PIVOT:
            ratio = duals[k] / share[k]
            if ratio < least or (ratio == least and basis[k] < basis[leaving]):
                leaving, least = k, ratio
    if leaving < 0:
        return False
    for d in range(size):
        inverse[leaving, d] /= share[leaving]
        x[d] -= violation * inverse[leaving, d]
    for k in range(size):
        duals[k] = max(duals[k] - least * share[k], 0.0)
        if k != leaving:
            for d in range(size):
                inverse[k, d] -= share[k] * inverse[leaving, d]
    duals[leaving] = least
    basis[leaving] = entering
    return True


@algebraic_part
def _violated_rows(
    columns: Real, limit: Real, x: Real, n_rows: int, violations: Real, candidates: Index, first_only: bool
) -> tuple[int, float]:
    """Write the rows that are violated the most, or the first one, into ``candidates``; how many, and the violation."""
    for i in range(n_rows):
        violations[i] = -limit[i]
    for d in range(len(x)):
        column, unknown = columns[d], x[d]
        for i in range(n_rows):
            violations[i] += column[i] * unknown
    worst = FEASIBLE
    for i in range(n_rows):
        worst = max(worst, violations[i])
    count = 0
    if worst > FEASIBLE:
        least = FEASIBLE if first_only else max(FEASIBLE, CANDIDATES * worst)
        for i in range(n_rows):
            candidates[count] = i
            count += violations[i] > least
            if first_only and count:
                break
    return count, worst


@algebraic_part
def _most_violated(rows: Real, limit: Real, x: Real, candidates: Index, count: int) -> tuple[int, float]:
    """The most violated of the ``candidates``, -1 if none, and by how much; what was above rounding before still is."""
    entering, worst = -1, 0.5 * FEASIBLE
    for j in range(count):
        i = candidates[j]
        violation = -limit[i]
        for d in range(len(x)):
            violation += rows[i, d] * x[d]
        if violation > worst:
            entering, worst = i, violation
    return entering, worst


@algebraic_part
def _farthest_disc(x: Real, radii: Real, worst: float) -> int:
    """The disc of ``radii`` (n_discs,) beyond which ``x`` lies farthest and by more than ``worst``; -1 if none."""
    farthest = -1
    for k in range(radii.shape[0]):
        overshoot = np.hypot(x[2 * k], x[2 * k + 1]) - radii[k]
        if overshoot > worst + CONE_TOLERANCE * radii[k]:
            farthest, worst = k, overshoot
    return farthest


@algebraic_part
def _add_tangent(disc: int, row: int, x: Real, radii: Real, rows: Real, columns: Real, limit: Real) -> None:
    """Write the tangent of a disc towards ``x`` as a ``row`` of the program, into rows and columns."""
    reach = np.hypot(x[2 * disc], x[2 * disc + 1])
    rows[row] = 0.0
    for d in range(2 * disc, 2 * disc + 2):
        rows[row, d] = x[d] / reach
    for d in range(rows.shape[1]):
        columns[d, row] = rows[row, d]
    limit[row] = radii[disc]


@entry
def _solve(
    columns: Real,
    limits: Real,
    radii: Real,
    basis: Index,
    inverse: Real,
    duals: Real,
    points: Real,
    state: Index,
    last_basis: Index,
) -> None:
    """Fill ``points`` (n, n_unknowns) and ``state`` (n,): 0 solved, 1 infeasible, 2 given up.

    ``columns`` (n_unknowns, n_rows) are those of the rows: the violations of all are found several at once. The last
    ``MOST_TANGENTS`` of each disc are room for its tangents. ``inverse`` has the columns of the basis' inverse as rows;
    ``last_basis`` (n_unknowns,) becomes that of the last program.
    """
    size, discs = columns.shape[0], radii.shape[1]
    n_fixed = columns.shape[1] - MOST_TANGENTS * discs
    own_inverse, own_duals = np.empty((size, size)), np.empty(size)
    own_columns, rows = columns.copy(), columns.T.copy()
    share, limit, violations = np.empty(size), np.empty(columns.shape[1]), np.empty(columns.shape[1])
    candidates = np.empty(columns.shape[1] + 1, np.int64)
    for s in range(limits.shape[0]):
        x, n_rows, pivots = points[s], n_fixed, 0
        for i in range(n_fixed):
            limit[i] = limits[s, i]
        x[:] = 0.0
        for k in range(size):
            last_basis[k], own_duals[k] = basis[k], duals[k]
            for d in range(size):
                own_inverse[k, d] = inverse[k, d]
                x[d] += inverse[k, d] * limit[basis[k]]
        state[s] = 2
        while pivots < MOST_PIVOTS * size:
            count, worst = _violated_rows(
                own_columns, limit, x, n_rows, violations, candidates, first_only=pivots >= MOST_VIOLATED * size
            )
            if count == 0:
                farthest = _farthest_disc(x, radii[s], worst)
                if farthest < 0:
                    state[s] = 0
                    break
                if n_rows == columns.shape[1]:
                    break
                _add_tangent(farthest, n_rows, x, radii[s], rows, own_columns, limit)
                candidates[0], count = n_rows, 1
                n_rows += 1
            can_leave = True
            while can_leave and pivots < MOST_PIVOTS * size:
                entering, worst = _most_violated(rows, limit, x, candidates, count)
                if entering < 0:
                    break
                pivots += 1
                can_leave = _exchange(rows[entering], entering, worst, last_basis, own_inverse, own_duals, share, x=x)
            if not can_leave:
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
        If the programs are unbounded.

    Notes
    -----
    What is given up, since rounding leads its pivots in a circle, is solved by a general program.
    """
    discs, size = radii.shape[1], rows.shape[1]
    scale = np.abs(rows).max(axis=0)
    scale[: 2 * discs] = 1.0
    box = np.repeat(np.eye(size)[: 2 * discs], 2, axis=0)
    box[1::2] *= -1.0
    scaled, direction = np.vstack([rows / scale, box]), objective / scale
    all_limits = np.hstack([limits, np.repeat(radii, 4, axis=1)]) if discs else limits
    basis = _optimal_basis(direction, scaled)
    room = np.vstack([scaled, np.zeros((MOST_TANGENTS * discs, size))])
    points, state = _points(direction, basis, room, all_limits, radii)[:2]
    points, exists = points / scale, state == 0
    for k in np.flatnonzero(state == 2):
        point = cut_program(objective, rows, limits[k], radii[k])
        exists[k] = point is not None
        points[k] = point if point is not None else points[k]
    return points, exists


def _points(objective: Real, basis: Index, rows: Real, limits: Real, radii: Real) -> tuple[Real, Index, Index]:
    """Points (n, n_unknowns), their states (n,), see ``_solve``, and the basis of the last, from a common ``basis``."""
    inverse = np.linalg.inv(rows[basis])
    duals, last_basis = np.maximum(objective @ inverse, 0.0), basis.copy()
    points, state = np.empty((len(limits), len(basis))), np.empty(len(limits), np.int64)
    of_programs = np.ascontiguousarray(limits), np.ascontiguousarray(radii)
    columns = np.ascontiguousarray(rows.T), *of_programs, basis, np.ascontiguousarray(inverse.T), duals
    _solve(*columns, points, state, last_basis=last_basis)
    return points, state, last_basis


def _optimal_basis(objective: Real, rows: Real) -> Index:
    """Rows (n_unknowns,) that are met at the optimum of limits 1, whose weights >= 0 make the objective."""
    basis = _basis_from_far(objective, rows)
    if basis is not None:
        return basis
    basis = _basis_of_weights(objective, rows)
    return _points(objective, basis, rows, np.ones((1, len(rows))), np.zeros((1, 0)))[2]


def _basis_from_far(objective: Real, rows: Real) -> Index | None:
    """As ``_optimal_basis``, by pivots from a box far beyond the limits; None if it is not found.

    Notes
    -----
    Of a box the basis is dual feasible at once. Where the objective is a single unknown all weights but one are 0, and
    pivots that lower none could run in a circle: to each a share of its own is added (Charnes, Econometrica 20 (1952)
    160). What the rows found make of the objective itself decides.
    """
    n_rows, size = rows.shape
    side, share = np.where(objective < 0, -1.0, 1.0), PERTURBATION * np.abs(objective).max()
    perturbed = objective + side * share * (1.0 + np.arange(size) / size)
    in_box = np.vstack([rows, np.diag(side)])
    limits = np.append(np.ones(n_rows), np.full(size, FAR))[None]
    _, state, basis = _points(perturbed, n_rows + np.arange(size), in_box, limits, np.zeros((1, 0)))
    if state[0] != 0 or np.any(basis >= n_rows):
        return None
    return basis if np.all(np.linalg.solve(rows[basis].T, objective) > -LEAST_WEIGHT * share) else None


def _basis_of_weights(objective: Real, rows: Real) -> Index:
    """Rows (n_unknowns,) whose weights >= 0 make the objective, those of 0 as independent as can be."""
    weights, misfit = scipy.optimize.nnls(rows.T, objective)
    if misfit > 1e-9 * np.linalg.norm(objective):
        raise ArithmeticError("a linear program is unbounded: no contact stops a motion")
    basis = np.flatnonzero(weights > 0)
    span = np.linalg.qr(rows[basis].T)[0]
    off_span = rows - rows @ span @ span.T  # each further row is the one that is farthest from those chosen
    farthest = scipy.linalg.qr(off_span.T, mode="r", pivoting=True)[1]
    return np.append(basis, farthest[: rows.shape[1] - len(basis)])
