"""The inverse of H = law' + C over the active contacts of a block, which grows and shrinks with them (compiled parts).

At 10 to 30 contacts a product with the inverse takes a fifth of the time of two triangular solves, whose rows wait for
each other (30 ns against 200 at 16), and a contact that opens leaves it by one update. Its rounding errors only slow
Newton down: the residual is formed without it.
"""

import numpy as np

from pipeline.arrays import Real
from pipeline.model.compiled import algebraic_part
from pipeline.model.equilibrium.blocks import System, Workspace, first_of, moves, part_of


@algebraic_part
def product(inverse: Real, n: int, x: Real, y: Real) -> None:
    """y = inverse x over the first n; x, y (n,)."""
    for r in range(n):
        row = inverse[r]
        dot = 0.0
        for k in range(n):
            dot += row[k] * x[k]
        y[r] = dot


@algebraic_part
def include(system: System, b: int, work: Workspace) -> bool:
    """Grow the inverse of a block by the first of its active contacts that is not in it; false if not positive."""
    part = part_of(work.active, work, b)
    block_start, p = first_of(work.active, system.blocks[b]), work.sizes[b, 2]
    inverse, held_rows, right_sides, column = part.inverse, work.schur, part.inside, work.column
    active, step, jacobian = part.active, work.step, system.contact_jacobian
    i = active[p]
    row = system.compliance[i]
    for row_number in range(p):
        right_sides[row_number] = row[active[row_number] - block_start]
    product(inverse, p, right_sides, column)
    pivot = row[i - block_start] + part.slope[p]
    for row_number in range(p):
        pivot -= right_sides[row_number] * column[row_number]
    if not pivot > 0.0:
        return False
    share = 1.0 / pivot
    column[p] = -1.0
    for r in range(p + 1):
        inverse[r, p] = 0.0
        inverse[p, r] = 0.0
    for r in range(p + 1):
        factor, target = share * column[r], inverse[r]
        for k in range(p + 1):
            target[k] += factor * column[k]
    for d in range(held_rows.shape[0]):
        if not moves(work.active, system.moving[b], d):
            continue
        pull, target = jacobian[d, i], part.projection[d]
        for row_number in range(p):
            pull -= right_sides[row_number] * target[row_number]
        target[p] = 0.0
        step[d] = pull
        pull *= share
        for r in range(p + 1):
            target[r] -= pull * column[r]
        for e in range(d + 1):
            if moves(work.active, system.moving[b], e):
                held_rows[d, e] += pull * step[e]
    work.sizes[b, 2] += 1
    return True


@algebraic_part
def exclude(system: System, b: int, p: int, work: Workspace) -> None:
    """Shrink the inverse of a block by the contact at position p of those in it; the last one takes its place."""
    part = part_of(work.active, work, b)
    inverse, projection, held_rows, column = part.inverse, part.projection, work.schur, work.column
    last_row = work.sizes[b, 2] - 1
    share = 1.0 / inverse[p, p]
    for d in range(held_rows.shape[0]):
        if not moves(work.active, system.moving[b], d):
            continue
        for e in range(d + 1):
            if moves(work.active, system.moving[b], e):
                held_rows[d, e] -= share * projection[d, p] * projection[e, p]
    for r in range(last_row + 1):
        column[r] = inverse[p, r]
    for d in range(held_rows.shape[0]):
        factor, target = share * projection[d, p], projection[d]
        for r in range(last_row + 1):
            target[r] -= factor * column[r]
        target[p] = target[last_row]
    for r in range(last_row + 1):
        factor, target = share * column[r], inverse[r]
        for k in range(last_row + 1):
            target[k] -= factor * column[k]
        target[p] = target[last_row]
    for k in range(last_row):
        inverse[p, k] = inverse[last_row, k]
    work.sizes[b, 2] = last_row


@algebraic_part
def solve_positive_tangent(tangent: Real, x: Real) -> bool:
    """Solve tangent x = x (n,) in place by Cholesky's factor of its lower triangle; false if not positive definite."""
    n = x.shape[0]
    for i in range(n):
        for j in range(i + 1):
            dot = tangent[i, j]
            for k in range(j):
                dot -= tangent[i, k] * tangent[j, k]
            if j < i:
                tangent[i, j] = dot * tangent[j, j]
            elif dot > 0.0:
                tangent[i, i] = 1.0 / np.sqrt(dot)  # inverses of the pivots, since divisions are slow
            else:
                return False
    for i in range(n):
        for k in range(i):
            x[i] -= tangent[i, k] * x[k]
        x[i] *= tangent[i, i]
    for i in range(n - 1, -1, -1):
        x[i] *= tangent[i, i]
        for k in range(i):
            x[k] -= tangent[i, k] * x[i]
    return True


@algebraic_part
def solve_tangent(tangent: Real, x: Real) -> bool:
    """Solve tangent x = x (n,) in place by elimination with row pivots; false if singular."""
    n = x.shape[0]
    for k in range(n):
        pivot = k
        for r in range(k + 1, n):
            if abs(tangent[r, k]) > abs(tangent[pivot, k]):
                pivot = r
        if not abs(tangent[pivot, k]) > 0.0:
            return False
        if pivot != k:
            x[k], x[pivot] = x[pivot], x[k]
            for c in range(k, n):
                tangent[k, c], tangent[pivot, c] = tangent[pivot, c], tangent[k, c]
        for r in range(k + 1, n):
            factor = tangent[r, k] / tangent[k, k]
            for c in range(k + 1, n):
                tangent[r, c] -= factor * tangent[k, c]
            x[r] -= factor * x[k]
    for k in range(n - 1, -1, -1):
        for c in range(k + 1, n):
            x[k] -= tangent[k, c] * x[c]
        x[k] /= tangent[k, k]
    return True
