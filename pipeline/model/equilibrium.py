"""The one nonlinear solve: contact forces and rigid motions of a reducer under output torques, batched over samples.

Unknowns of a load step are the contact forces F >= 0 [N] and the rigid motions q [mm, rad]:

    law(F) + C F + gap - closing q = 0   where F > 0,   closing q <= C F + gap elsewhere,
    closing^T F + bearing(q) = load,

the stationarity of a convex potential, so F is unique. The active contacts are found by a primal-dual active set:
Newton on the closed contacts, then contacts are dropped where the local deflection has become negative and added
where an open contact is penetrated. Each step eliminates the forces (Cholesky of law' + C on the active contacts) and
then solves the few rigid motions; the factor is kept, from load step to load step, until the active set changes or
convergence slows down. A start that leads nowhere is replaced by an interior-point iteration.

Array order: (n_samples, n_torques, n_contacts or n_motions).
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from pipeline.model.contact import ContactLaws
from pipeline.model.profile import Real
from pipeline.model.reducer import Bearing, Reducer

FORCE_TOLERANCE = 1e-12
"""A step is solved when no active contact's deflection is off by more than this share of the largest one ..."""
BALANCE_TOLERANCE = 1e-12
"""... and no rigid motion's balance by more than this share of the largest of its terms."""
ACCEPTED = 1e-9
"""A step that ends above this residual (of either kind) is a failed one."""
STEP_LIMIT = 100
"""Newton steps from one start before it is given up."""
INTERIOR_STEPS = 80
"""Steps of the interior-point iteration that finds another start; about 30 are usual."""
INTERIOR_END = 1e-10
"""Complementarity, in units of load times stride, at which the interior point shows which contacts are closed."""
CENTRING = 0.1
"""Share of the complementarity that an interior-point step aims at."""
SLOW = 0.05
"""The factor is renewed when an iteration reduces the residual by less than this factor."""
REGULAR = 1e-9
"""Share of the mean contact stiffness that keeps a motion solvable that nothing holds at the moment."""
OPEN = 1e-13
"""Penetration [mm] below which an open contact is not added; rounding of positions near 1e2 mm."""


@dataclass(frozen=True)
class Equilibria:
    """Solutions of ``n`` samples at ``n_torques`` output torques.

    Attributes
    ----------
    motion : (n, n_torques, n_motions) [mm, rad]
    force : (n, n_torques, n_contacts) [N]
    iterations : (n, n_torques) Newton steps
    residual : (n, n_torques) the larger of the two relative residuals
    converged : (n, n_torques) whether it met ``ACCEPTED``
    """

    motion: Real
    force: Real
    iterations: np.ndarray
    residual: Real
    converged: np.ndarray


_MATH = {"reassoc", "contract", "nsz", "arcp"}


@njit(cache=True, nogil=True, fastmath=_MATH)
def _law(force, a, c, k, m, limit):
    """Local deflection and compliance of one closed contact."""
    inside = min(force, limit)
    log = np.log(inside)
    deflection = inside * (a - c * log)
    slope = a - c * (1.0 + log)
    if k > 0.0:
        powered = k * inside ** (m - 1.0)
        deflection += inside * powered
        slope += m * powered
    return deflection + (force - inside) * slope, slope


@njit(cache=True, nogil=True, fastmath=_MATH)
def _closing_force(penetration, own, a, c, k, m, limit):
    """Force of one contact with ``law(F) + own F = penetration``, to a few per cent: a start for Newton."""
    force = penetration / (own + abs(a) + c)
    for _ in range(6):
        deflection, slope = _law(force, a, c, k, m, limit)
        force = max(0.1 * force, force + (penetration - deflection - own * force) / (slope + own))
    return force


@njit(cache=True, nogil=True, fastmath=_MATH)
def _factorise(matrix, n):
    """Cholesky factor of the leading n x n block, in place, lower triangle; false if not positive definite."""
    for i in range(n):
        for j in range(i + 1):
            dot = 0.0
            for k in range(j):
                dot += matrix[i, k] * matrix[j, k]
            if i == j:
                pivot = matrix[i, i] - dot
                if not pivot > 0.0:
                    return False
                matrix[i, i] = np.sqrt(pivot)
            else:
                matrix[i, j] = (matrix[i, j] - dot) / matrix[j, j]
    return True


@njit(cache=True, nogil=True, fastmath=_MATH)
def _forward(factor, n, y):
    """Solve L x = y in place."""
    for i in range(n):
        dot = 0.0
        for k in range(i):
            dot += factor[i, k] * y[k]
        y[i] = (y[i] - dot) / factor[i, i]


@njit(cache=True, nogil=True, fastmath=_MATH)
def _backward(factor, n, y):
    """Solve L^T x = y in place."""
    for i in range(n - 1, -1, -1):
        y[i] /= factor[i, i]
        for k in range(i):
            y[k] -= factor[i, k] * y[i]


@njit(cache=True, nogil=True, fastmath=_MATH)
def _bearing(bearing, clearance, motion, thrust, spring):
    """Force and tangent of the bearing into ``spring``: fx, fy, kxx, kxy, kyy and, beyond a clearance, ux, uy, miss.

    A linear bearing without clearance is a plain spring. Any other pushes with the unknown ``thrust`` along the
    displacement u, like a contact: |d| - clearance - (thrust/K)^(1/n) = 0 is linearised with it, so that the
    disk can run around the edge of the clearance under a small force.
    """
    stiffness, exponent = bearing
    x, y = motion[0], motion[1]
    spring[:] = 0.0
    if exponent == 1.0 and clearance == 0.0:
        spring[0], spring[1], spring[2], spring[4] = stiffness * x, stiffness * y, stiffness, stiffness
        return
    distance = np.sqrt(x * x + y * y)
    if thrust[0] == 0.0 and distance > clearance:
        thrust[0] = stiffness * (distance - clearance) ** exponent
    if thrust[0] == 0.0 or distance == 0.0:
        thrust[0] = 0.0
        return
    depth = (thrust[0] / stiffness) ** (1.0 / exponent)
    radial, across = exponent * thrust[0] / depth, thrust[0] / distance
    ux, uy = x / distance, y / distance
    miss = distance - clearance - depth
    push = thrust[0] + radial * miss
    spring[0], spring[1] = push * ux, push * uy
    spring[2] = radial * ux * ux + across * uy * uy
    spring[3] = (radial - across) * ux * uy
    spring[4] = radial * uy * uy + across * ux * ux
    spring[5], spring[6], spring[7] = radial * ux, radial * uy, radial * miss


@njit(cache=True, nogil=True, fastmath=_MATH)
def _reach(closing, i, motion):
    """Approach of contact i by rigid motions."""
    total = 0.0
    for d in range(motion.shape[0]):
        total += closing[i, d] * motion[d]
    return total


@njit(cache=True, nogil=True, fastmath=_MATH)
def _elastic(compliance, force, active, n_active, elastic):
    """Deflection C F of every contact by the forces of the active ones."""
    elastic[:] = 0.0
    for j in range(n_active):
        row, f = compliance[active[j]], force[active[j]]
        for i in range(elastic.shape[0]):
            elastic[i] += row[i] * f


@njit(cache=True, nogil=True, fastmath=_MATH)
def _close(reducer, laws, gap, motion, force, active, n_active, elastic):
    """Add the open contacts that are penetrated, each with the force that would open it again."""
    closing, compliance = reducer
    a, c, k, m, limit = laws
    for i in range(gap.shape[0]):
        if force[i] > 0.0:
            continue
        depth = _reach(closing, i, motion) - gap[i] - elastic[i]
        if depth > OPEN:
            force[i] = _closing_force(depth, compliance[i, i], a[i], c[i], k[i], m[i], limit[i])
            active[n_active] = i
            n_active += 1
            for r in range(gap.shape[0]):
                elastic[r] += compliance[i, r] * force[i]
    return n_active


@njit(cache=True, nogil=True, fastmath=_MATH)
def _misfit(reducer, laws, gap, motion, force, active, n_active, elastic, miss, slope):
    """Misfit of the deflection of every active contact, and the law's tangents; returns the relative misfit."""
    closing = reducer[0]
    a, c, k, m, limit = laws
    largest, off = 1e-300, 0.0
    for j in range(n_active):
        i = active[j]
        local, slope[j] = _law(force[i], a[i], c[i], k[i], m[i], limit[i])
        miss[j] = local + elastic[i] + gap[i] - _reach(closing, i, motion)
        largest = max(largest, local + elastic[i])
        off = max(off, abs(miss[j]))
    return off / largest


@njit(cache=True, nogil=True, fastmath=_MATH)
def _imbalance(reducer, torque, output, spring, force, active, n_active, balance):
    """What is unbalanced of every rigid motion; returns the largest share of the sum of its terms."""
    closing = reducer[0]
    relative = 0.0
    for d in range(balance.shape[0]):
        total = -torque if d == output else 0.0
        if d < 2:
            total += spring[d]
        scale = abs(total)
        for j in range(n_active):
            term = closing[active[j], d] * force[active[j]]
            total += term
            scale += abs(term)
        balance[d] = total
        relative = max(relative, abs(total) / max(scale, 1e-300))
    return relative


@njit(cache=True, nogil=True, fastmath=_MATH)
def _renew(reducer, active, n_active, slope, factor, projected):
    """Factor L of law' + C on the active contacts, and L^-1 closing; false if not positive definite."""
    closing, compliance = reducer
    for j in range(n_active):
        row = compliance[active[j]]
        for l in range(j):
            factor[j, l] = row[active[l]]
        factor[j, j] = row[active[j]] + slope[j]
    if not _factorise(factor, n_active):
        return False
    for d in range(closing.shape[1]):
        for j in range(n_active):
            projected[d, j] = closing[active[j], d]
        _forward(factor, n_active, projected[d])
    return True


@njit(cache=True, nogil=True, fastmath=_MATH)
def _newton(n_active, factor, projected, spring, stiffness, miss, balance, tangent, step):
    """Newton step: of the motions in ``step``, of the active forces in ``miss``; false if singular.

    (closing^T H^-1 closing + bearing) dq = closing^T H^-1 miss - balance;  H dF = closing dq - miss.
    """
    n_motions = step.shape[0]
    _forward(factor, n_active, miss)
    largest = stiffness
    for d in range(n_motions):
        for e in range(d + 1):
            dot = 0.0
            for j in range(n_active):
                dot += projected[d, j] * projected[e, j]
            tangent[d, e] = dot
        largest = max(largest, tangent[d, d])
        dot = 0.0
        for j in range(n_active):
            dot += projected[d, j] * miss[j]
        step[d] = dot - balance[d]
    tangent[0, 0] += spring[2]
    tangent[1, 0] += spring[3]
    tangent[1, 1] += spring[4]
    for d in range(n_motions):
        tangent[d, d] += REGULAR * largest
    if not _factorise(tangent, n_motions):
        return False
    _forward(tangent, n_motions, step)
    _backward(tangent, n_motions, step)
    for j in range(n_active):
        value = -miss[j]
        for d in range(n_motions):
            value += projected[d, j] * step[d]
        miss[j] = value
    _backward(factor, n_active, miss)
    return True


@njit(cache=True, nogil=True, fastmath=_MATH)
def _advance(reducer, laws, gap, motion, force, active, n_active, step, elastic):
    """Add the Newton step to the forces; a contact that it would pull opens, or stays closed if penetrated."""
    closing, compliance = reducer
    a, c, k, m, limit = laws
    pulled = False
    for j in range(n_active):
        i = active[j]
        force[i] += step[j]
        if force[i] <= 0.0:
            force[i] = 0.0
            pulled = True
    if not pulled:
        return n_active
    _elastic(compliance, force, active, n_active, elastic)
    kept = 0
    for j in range(n_active):
        i = active[j]
        if force[i] == 0.0:
            depth = _reach(closing, i, motion) - gap[i] - elastic[i]
            if depth <= OPEN:
                continue
            force[i] = _closing_force(depth, compliance[i, i], a[i], c[i], k[i], m[i], limit[i])
        active[kept] = i
        kept += 1
    return kept


@njit(cache=True, nogil=True, fastmath=_MATH)
def _move(motion, step, length, spring, thrust):
    """Add a share of the step to the motions and to the bearing's thrust, which ends where it would pull."""
    if thrust[0] > 0.0:
        thrust[0] = max(thrust[0] + length * (spring[5] * step[0] + spring[6] * step[1] + spring[7]), 0.0)
    for d in range(motion.shape[0]):
        motion[d] += length * step[d]


@njit(cache=True, nogil=True, fastmath=_MATH)
def _stride(torque, output, gap, reducer, laws):
    """Largest sensible move of a contact [mm]: the widest gap and the deflection of one that carries all the load."""
    closing, compliance = reducer
    a, c, k, m, limit = laws
    widest, deepest = 0.0, 0.0
    for i in range(gap.shape[0]):
        widest = max(widest, abs(gap[i]))
        arm = abs(closing[i, output])
        if arm > 0.0:
            force = min(abs(torque) / arm, limit[i])
            local, _ = _law(force, a[i], c[i], k[i], m[i], limit[i])
            deepest = max(deepest, local + compliance[i, i] * force)
    return widest + deepest


@njit(cache=True, nogil=True, fastmath=_MATH)
def _interior(torque, output, gap, reducer, laws, bearing, clearance, motion, force, active, work):
    """Near-solution from no start at all, by a primal-dual interior-point iteration over all contacts.

    Force times slack tends to zero along the central path of the convex problem, which has no active set
    to guess. Returns the number of contacts that it leaves closed.
    """
    factor, projected, elastic, miss, slope, balance, tangent, step, spring, thrust = work
    n = gap.shape[0]
    stride = _stride(torque, output, gap, reducer, laws)
    load = abs(torque) / np.max(np.abs(reducer[0][:, output]))
    slack = np.full(n, stride)
    motion[:] = 0.0
    thrust[0] = 0.0
    for i in range(n):
        active[i] = i
        force[i] = load
    for _ in range(INTERIOR_STEPS):
        _elastic(reducer[1], force, active, n, elastic)
        _bearing(bearing, clearance, motion, thrust, spring)
        _misfit(reducer, laws, gap, motion, force, active, n, elastic, miss, slope)
        _imbalance(reducer, torque, output, spring, force, active, n, balance)
        complementarity = np.dot(force, slack) / n
        if complementarity < INTERIOR_END * load * stride:
            break
        for i in range(n):
            slope[i] += slack[i] / force[i]
            miss[i] -= CENTRING * complementarity / force[i]
        if not _renew(reducer, active, n, slope, factor, projected):
            break
        if not _newton(n, factor, projected, spring, bearing[0], miss, balance, tangent, step):
            break
        length = 1.0
        for i in range(n):
            slope[i] = (CENTRING * complementarity - slack[i] * miss[i]) / force[i] - slack[i]  # step of the slack
            if miss[i] < 0.0:
                length = min(length, -0.95 * force[i] / miss[i])
            if slope[i] < 0.0:
                length = min(length, -0.95 * slack[i] / slope[i])
        _move(motion, step, length, spring, thrust)
        for i in range(n):
            force[i] += length * miss[i]
            slack[i] += length * slope[i]
    kept = 0
    for i in range(n):
        if force[i] * stride > slack[i] * load:
            active[kept] = i
            kept += 1
        else:
            force[i] = 0.0
    return kept


@njit(cache=True, nogil=True, fastmath=_MATH)
def _newton_steps(torque, output, gap, reducer, laws, bearing, clearance, motion, force, active, n_active, work, fresh):
    """Active-set Newton from (motion, force, active), changed in place; ``fresh``: ``work[0]`` holds their factor.

    Returns the number of active contacts, the iterations and the residual.
    """
    factor, projected, elastic, miss, slope, balance, tangent, step, spring, thrust = work
    previous, residual = np.inf, np.inf
    for iteration in range(STEP_LIMIT):
        _elastic(reducer[1], force, active, n_active, elastic)
        before = n_active
        n_active = _close(reducer, laws, gap, motion, force, active, n_active, elastic)
        _bearing(bearing, clearance, motion, thrust, spring)
        off = _misfit(reducer, laws, gap, motion, force, active, n_active, elastic, miss, slope)
        unbalanced = _imbalance(reducer, torque, output, spring, force, active, n_active, balance)
        residual = max(off, unbalanced)
        if n_active == before and off <= FORCE_TOLERANCE and unbalanced <= BALANCE_TOLERANCE:
            return n_active, iteration, residual
        if n_active != before or residual > SLOW * previous or not fresh:
            fresh = _renew(reducer, active, n_active, slope, factor, projected)
        previous = residual
        if not (fresh and _newton(n_active, factor, projected, spring, bearing[0], miss, balance, tangent, step)):
            break
        _move(motion, step, 1.0, spring, thrust)
        before = n_active
        n_active = _advance(reducer, laws, gap, motion, force, active, n_active, miss, elastic)
        fresh = n_active == before
    return n_active, STEP_LIMIT, max(residual, 2 * ACCEPTED)


@njit(cache=True, nogil=True, fastmath=_MATH)
def _solve_step(torque, output, gap, reducer, laws, bearing, clearance, motion, force, active, n_active, work):
    """One load step from (motion, force, active), changed in place; a start that leads nowhere is replaced.

    Returns the number of active contacts, the iterations and the residual.
    """
    n_active, iterations, residual = _newton_steps(
        torque, output, gap, reducer, laws, bearing, clearance, motion, force, active, n_active, work, n_active > 0
    )
    if residual <= ACCEPTED:
        return n_active, iterations, residual
    n_active = _interior(torque, output, gap, reducer, laws, bearing, clearance, motion, force, active, work)
    n_active, more, residual = _newton_steps(
        torque, output, gap, reducer, laws, bearing, clearance, motion, force, active, n_active, work, False
    )
    return n_active, iterations + INTERIOR_STEPS + more, residual


@njit(cache=True, nogil=True)
def _solve_batch(torques, output, gap, reducer, laws, bearing, clearance, start, motion, force, iterations, residual):
    """Every sample through its torques in order; the last four arrays are filled."""
    n_contacts, n_motions = reducer[0].shape
    thrust = np.zeros(1)
    work = (
        np.empty((n_contacts, n_contacts)), np.empty((n_motions, n_contacts)), np.empty(n_contacts),
        np.empty(n_contacts), np.empty(n_contacts), np.empty(n_motions), np.empty((n_motions, n_motions)),
        np.empty(n_motions), np.zeros(8), thrust,
    )
    active = np.empty(n_contacts, np.int64)
    q, f = np.empty(n_motions), np.empty(n_contacts)
    for s in range(gap.shape[0]):
        q[:] = start[s]
        f[:] = 0.0
        thrust[0] = 0.0
        n_active = 0
        for t in range(torques.shape[0]):
            n_active, iterations[s, t], residual[s, t] = _solve_step(
                torques[t], output, gap[s], reducer, laws, bearing, clearance[s], q, f, active, n_active, work
            )
            motion[s, t] = q
            force[s, t] = f


def solve(
    reducer: Reducer,
    bearing: Bearing,
    laws: ContactLaws,
    compliance: Real,
    gap: Real,
    bearing_clearance: Real,
    start: Real,
    torque: Real,
) -> Equilibria:
    """Equilibria of every sample at every output torque, in the order of ``torque``.

    Parameters
    ----------
    compliance : (n_contacts, n_contacts) [mm/N]
        Condensed compliance of the elastic bodies between the contacts; symmetric, positive semidefinite.
    gap : (n, n_contacts) [mm]
    bearing_clearance : (n,) [mm]
    start : (n, n_motions) [mm, rad]
        Motions to start from; any will do, near ones save iterations.
    torque : (n_torques,) [N mm]
        None of them zero: with play the zero-torque pose is not unique (``backlash.rigid_play`` has its ends).

    Notes
    -----
    A step that misses ``ACCEPTED`` is reported by ``converged``; the following steps still start from it.
    """
    n, n_contacts = gap.shape
    n_motions = len(reducer.motions)
    solution = Equilibria(
        motion=np.empty((n, len(torque), n_motions)),
        force=np.empty((n, len(torque), n_contacts)),
        iterations=np.empty((n, len(torque)), np.int64),
        residual=np.empty((n, len(torque))),
        converged=np.empty((n, len(torque)), bool),
    )
    _solve_batch(
        np.asarray(torque, float),
        reducer.output_motion,
        np.ascontiguousarray(gap),
        (np.ascontiguousarray(reducer.closing), np.ascontiguousarray(compliance)),
        (laws.linear, laws.logarithmic, laws.power, laws.exponent, laws.force_limit),
        (bearing.stiffness, bearing.exponent),
        np.ascontiguousarray(bearing_clearance, dtype=float),
        np.ascontiguousarray(start),
        solution.motion,
        solution.force,
        solution.iterations,
        solution.residual,
    )
    np.less_equal(solution.residual, ACCEPTED, out=solution.converged)
    return solution
