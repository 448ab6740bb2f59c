"""The one nonlinear solve: contact forces and rigid motions of a reducer under output torques, batched over samples.

Unknowns of a load step are the contact forces F >= 0 [N] and the rigid motions q [mm, rad]:

    law(F) + C F + gap - closing q = 0   where F > 0,   closing q <= C F + gap elsewhere,
    closing^T F + bearing(q) = load,

the stationarity of a convex potential, so F is unique. The active contacts are found by a primal-dual active set:
Newton on the closed contacts, then contacts are dropped where the local deflection has become negative and added
where an open contact is penetrated. Each step eliminates the forces (Cholesky of law' + C on the active contacts) and
then solves the few rigid motions; contacts between rigid bodies are uncoupled and need no factor. It is kept from load
step to load step: the laws are nearly linear, a new
contact is a new row, and only an opened contact or slow convergence asks for another. A load step starts from the
extrapolated forces of the steps before; a start that leads nowhere is replaced by an interior-point iteration. A linear
bearing without clearance is a compliance like the bodies' and leaves two motions fewer.

Array order: (n_samples, n_torques, n_contacts or n_motions).
"""

from dataclasses import dataclass

import numpy as np

from pipeline.model.compiled import algebraic_part, entry
from pipeline.model.contact import ContactLaws
from pipeline.model.profile import Real
from pipeline.model.reducer import Bearing, Reducer

FORCE_TOLERANCE = 1e-10
"""A step is solved when no active contact's deflection is off by more than this share of the largest one ..."""
BALANCE_TOLERANCE = 1e-12
"""... and no rigid motion's balance by more than this share of the sum of its terms."""
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
ALTERNATING = 5
"""Times that contacts or the bearing may close within a load step before such steps are halved: they may alternate."""
LARGEST_RISE = 2.5
"""Ratio of a load step's torque to the last one's beyond which steps are put in between: contacts close one by one."""
PATIENCE = 2.5
"""Steps with an old factor that cost as much as a new one, which needs about two."""
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


@algebraic_part
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


@algebraic_part
def _closing_force(penetration, own, a, c, k, m, limit):
    """Force of one contact with ``law(F) + own F = penetration``, to a few per cent: a start for Newton."""
    force = penetration / (own + abs(a) + c + k)
    for _ in range(6):
        deflection, slope = _law(force, a, c, k, m, limit)
        force = max(0.1 * force, force + (penetration - deflection - own * force) / (slope + own))
    return force


@algebraic_part
def _factorise(matrix, n):
    """Cholesky factor of the leading n x n block, in place; false if not positive definite.

    Lower triangle; the diagonal holds the inverses of the pivots, since divisions are slow.
    """
    for i in range(n):  # noqa: SIM110 (compiled)
        if not _append(matrix, i):
            return False
    return True


@algebraic_part
def _append(matrix, n):
    """Replace row n of a matrix by that of its Cholesky factor, whose n rows before stand already."""
    row = matrix[n]
    for j in range(n):
        dot = 0.0
        for k in range(j):
            dot += row[k] * matrix[j, k]
        row[j] = (row[j] - dot) * matrix[j, j]
    dot = 0.0
    for k in range(n):
        dot += row[k] * row[k]
    pivot = row[n] - dot
    if not pivot > 0.0:
        return False
    row[n] = 1.0 / np.sqrt(pivot)
    return True


@algebraic_part
def _forward(factor, n, y):
    """Solve L x = y in place."""
    for i in range(n):
        dot = 0.0
        for k in range(i):
            dot += factor[i, k] * y[k]
        y[i] = (y[i] - dot) * factor[i, i]


@algebraic_part
def _backward(factor, n, y):
    """Solve L^T x = y in place."""
    for i in range(n - 1, -1, -1):
        y[i] *= factor[i, i]
        for k in range(i):
            y[k] -= factor[i, k] * y[i]


@algebraic_part
def _bearing(bearing, clearance, motion, thrust, spring):
    """Force and tangent of the bearing into ``spring``: fx, fy, kxx, kxy, kyy, and how the thrust follows the motion.

    The bearing pushes with the unknown ``thrust`` along the displacement u, like a contact:
    |d| - clearance - (thrust/K)^(1/n) = 0 is linearised with it, so that the disk can run around the edge of the
    clearance under a small force.
    """
    stiffness, exponent = bearing
    x, y = motion[0], motion[1]
    spring[:] = 0.0
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


@algebraic_part
def _coupled(compliance, active, n_active, dense):
    """Positions in ``active`` of the contacts that elastic bodies couple, into ``dense``; returns their number."""
    n_dense = 0
    for j in range(n_active):
        if compliance[active[j], active[j]] > 0.0:
            dense[n_dense] = j
            n_dense += 1
    return n_dense


@algebraic_part
def _deflect(reducer, gap, motion, force, active, dense, n_dense, elastic, depth):
    """Elastic deflection of every contact, and the local one that is left: approach - gap - elastic."""
    closing, compliance = reducer
    n = gap.shape[0]
    elastic[:] = 0.0
    for p in range(n_dense):
        row, f = compliance[active[dense[p]]], force[active[dense[p]]]
        for i in range(n):
            elastic[i] += row[i] * f
    for i in range(n):
        depth[i] = -gap[i] - elastic[i]
    for d in range(motion.shape[0]):
        row, q = closing[d], motion[d]
        for i in range(n):
            depth[i] += row[i] * q


@algebraic_part
def _misfit(laws, force, active, n_active, elastic, depth, miss, slope):
    """Misfit of the deflection of every active contact, and the law's tangents; returns the relative misfit."""
    a, c, k, m, limit = laws
    largest, off = 1e-300, 0.0
    for j in range(n_active):
        i = active[j]
        local, slope[j] = _law(force[i], a[i], c[i], k[i], m[i], limit[i])
        miss[j] = local - depth[i]
        largest = max(largest, local + elastic[i])
        off = max(off, abs(miss[j]))
    return off / largest


@algebraic_part
def _imbalance(closing, torque, output, planar, spring, force, active, n_active, balance):
    """What is unbalanced of every rigid motion; returns the largest share of the sum of its terms."""
    relative = 0.0
    for d in range(balance.shape[0]):
        total = -torque if d == output else 0.0
        if planar and d < 2:
            total += spring[d]
        scale = abs(total)
        row = closing[d]
        for j in range(n_active):
            term = row[active[j]] * force[active[j]]
            total += term
            scale += abs(term)
        balance[d] = total
        relative = max(relative, abs(total) / max(scale, 1e-300))
    return relative


@algebraic_part
def _add_row(reducer, active, dense, p, slope, factor, projected, held):
    """Row p of the factor L of H = law' + C and of L^-1 closing, and its share in closing^T H^-1 closing."""
    closing, compliance = reducer
    i = active[dense[p]]
    row = compliance[i]
    for other in range(p):
        factor[p, other] = row[active[dense[other]]]
    factor[p, p] = row[i] + slope[dense[p]]
    if not _append(factor, p):
        return False
    for d in range(closing.shape[0]):
        dot = closing[d, i]
        for other in range(p):
            dot -= factor[p, other] * projected[d, other]
        projected[d, p] = dot * factor[p, p]
        for e in range(d + 1):
            held[d, e] += projected[d, p] * projected[e, p]
    return True


@algebraic_part
def _newton(
    closing,
    active,
    n_active,
    dense,
    n_dense,
    factor,
    projected,
    held,
    planar,
    spring,
    slope,
    miss,
    balance,
    right,
    tangent,
    step,
):
    """Newton step: of the motions in ``step``, of the active forces in ``miss``; false if singular.

    (closing^T H^-1 closing + bearing) dq = closing^T H^-1 miss - balance;  H dF = closing dq - miss.
    """
    n_motions = step.shape[0]
    for p in range(n_dense):
        right[p] = miss[dense[p]]
        slope[dense[p]] = 0.0  # marks what the factor holds
    _forward(factor, n_dense, right)
    for d in range(n_motions):
        dot = 0.0
        for p in range(n_dense):
            dot += projected[d, p] * right[p]
        step[d] = dot - balance[d]
        for e in range(d + 1):
            tangent[d, e] = held[d, e]
    for j in range(n_active):
        if slope[j] > 0.0:
            stiffness = 1.0 / slope[j]
            for d in range(n_motions):
                pull = closing[d, active[j]] * stiffness
                step[d] += pull * miss[j]
                for e in range(d + 1):
                    tangent[d, e] += pull * closing[e, active[j]]
    if planar:
        tangent[0, 0] += spring[2]
        tangent[1, 0] += spring[3]
        tangent[1, 1] += spring[4]
    stiffest = 0.0
    for d in range(n_motions):
        stiffest = max(stiffest, tangent[d, d])
    for d in range(n_motions):
        tangent[d, d] += REGULAR * stiffest
    if not _factorise(tangent, n_motions):
        return False
    _forward(tangent, n_motions, step)
    _backward(tangent, n_motions, step)
    for p in range(n_dense):
        value = -right[p]
        for d in range(n_motions):
            value += projected[d, p] * step[d]
        right[p] = value
    _backward(factor, n_dense, right)
    for j in range(n_active):
        if slope[j] > 0.0:
            value = -miss[j]
            for d in range(n_motions):
                value += closing[d, active[j]] * step[d]
            miss[j] = value / slope[j]
    for p in range(n_dense):
        miss[dense[p]] = right[p]
    return True


@algebraic_part
def _move(motion, step, length, planar, spring, thrust):
    """Add a share of the step to the motions and to the bearing's thrust, which ends where it would pull."""
    if planar and thrust[0] > 0.0:
        thrust[0] = max(thrust[0] + length * (spring[5] * step[0] + spring[6] * step[1] + spring[7]), 0.0)
    for d in range(motion.shape[0]):
        motion[d] += length * step[d]


@algebraic_part
def _open_pulled(reducer, laws, gap, motion, force, active, n_active, dense, n_dense, elastic, depth):
    """Judge the contacts that a step left without force: they open, or stay closed if they are still penetrated."""
    a, c, k, m, limit = laws
    _deflect(reducer, gap, motion, force, active, dense, n_dense, elastic, depth)
    kept = 0
    for j in range(n_active):
        i = active[j]
        if force[i] == 0.0:
            if depth[i] <= OPEN:
                continue
            force[i] = _closing_force(depth[i], reducer[1][i, i], a[i], c[i], k[i], m[i], limit[i])
        active[kept] = i
        kept += 1
    return kept


@algebraic_part
def _stride(torque, output, gap, reducer, laws):
    """Largest sensible move of a contact [mm]: the widest gap and the deflection of one that carries all the load."""
    closing, compliance = reducer
    a, c, k, m, limit = laws
    widest, deepest = 0.0, 0.0
    for i in range(gap.shape[0]):
        widest = max(widest, abs(gap[i]))
        arm = abs(closing[output, i])
        if arm > 0.0:
            force = min(abs(torque) / arm, limit[i])
            local, _ = _law(force, a[i], c[i], k[i], m[i], limit[i])
            deepest = max(deepest, local + compliance[i, i] * force)
    return widest + deepest


@algebraic_part
def _interior(torque, output, gap, reducer, laws, planar, bearing, clearance, motion, force, active, work):
    """Near-solution from no start at all, by a primal-dual interior-point iteration over all contacts.

    Force times slack tends to zero along the central path of the convex problem, which has no active set
    to guess. Returns the number of contacts that it leaves closed.
    """
    factor, projected, held, elastic, depth, miss, slope, balance, right, tangent, step, spring, thrust, dense = work
    n = gap.shape[0]
    stride = _stride(torque, output, gap, reducer, laws)
    load = abs(torque) / np.max(np.abs(reducer[0][output]))
    slack = np.full(n, stride)
    motion[:] = 0.0
    thrust[0] = 0.0
    for i in range(n):
        active[i] = i
        force[i] = load
    n_dense = _coupled(reducer[1], active, n, dense)
    for _ in range(INTERIOR_STEPS):
        _deflect(reducer, gap, motion, force, active, dense, n_dense, elastic, depth)
        if planar:
            _bearing(bearing, clearance, motion, thrust, spring)
        _misfit(laws, force, active, n, elastic, depth, miss, slope)
        _imbalance(reducer[0], torque, output, planar, spring, force, active, n, balance)
        complementarity = np.dot(force, slack) / n
        if complementarity < INTERIOR_END * load * stride:
            break
        held[:] = 0.0
        sound = True
        for i in range(n):
            slope[i] += slack[i] / force[i]
            miss[i] -= CENTRING * complementarity / force[i]
        for p in range(n_dense):
            sound = sound and _add_row(reducer, active, dense, p, slope, factor, projected, held)
        if not sound or not _newton(
            reducer[0],
            active,
            n,
            dense,
            n_dense,
            factor,
            projected,
            held,
            planar,
            spring,
            slope,
            miss,
            balance,
            right,
            tangent,
            step,
        ):
            break
        length = 1.0
        for i in range(n):
            slope[i] = (CENTRING * complementarity - slack[i] * miss[i]) / force[i] - slack[i]  # step of the slack
            if miss[i] < 0.0:
                length = min(length, -0.95 * force[i] / miss[i])
            if slope[i] < 0.0:
                length = min(length, -0.95 * slack[i] / slope[i])
        _move(motion, step, length, planar, spring, thrust)
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


@algebraic_part
def _worth_renewing(residual, previous):
    """Whether the old factor would need more than ``PATIENCE`` further steps, at the rate of the last one."""
    if residual >= previous:
        return True
    return np.log(residual / FORCE_TOLERANCE) > PATIENCE * np.log(previous / residual)


@algebraic_part
def _newton_steps(torque, output, gap, reducer, laws, planar, bearing, clearance, motion, force, active, state, work):
    """Active-set Newton from (motion, force, active), changed in place; returns the iterations and the residual.

    ``state`` holds the number of active contacts and of the rows of the factor that are theirs.
    """
    factor, projected, held, elastic, depth, miss, slope, balance, right, tangent, step, spring, thrust, dense = work
    a, c, k, m, limit = laws
    n_active, factored = state[0], state[1]
    n_dense = _coupled(reducer[1], active, n_active, dense)
    previous, residual, changes = np.inf, np.inf, 0
    for iteration in range(STEP_LIMIT):
        _deflect(reducer, gap, motion, force, active, dense, n_dense, elastic, depth)
        before = n_active
        for i in range(gap.shape[0]):
            if depth[i] > OPEN and force[i] == 0.0:
                force[i] = _closing_force(depth[i], reducer[1][i, i], a[i], c[i], k[i], m[i], limit[i])
                active[n_active] = i
                n_active += 1
        for j in range(before, n_active):
            row, f = reducer[1][active[j]], force[active[j]]
            if row[active[j]] > 0.0:
                dense[n_dense] = j
                n_dense += 1
                for i in range(gap.shape[0]):
                    elastic[i] += row[i] * f
                    depth[i] -= row[i] * f
        pushed = thrust[0] > 0.0
        if planar:
            _bearing(bearing, clearance, motion, thrust, spring)
        off = _misfit(laws, force, active, n_active, elastic, depth, miss, slope)
        unbalanced = _imbalance(reducer[0], torque, output, planar, spring, force, active, n_active, balance)
        residual = max(off, unbalanced)
        if n_active == before and off <= FORCE_TOLERANCE and unbalanced <= BALANCE_TOLERANCE:
            state[0], state[1] = n_active, factored
            return iteration, residual
        if n_active == before and _worth_renewing(residual, previous):
            factored = 0
        previous = residual
        if factored == 0:
            held[:] = 0.0
        sound = n_active > 0
        while sound and factored < n_dense:
            sound = _add_row(reducer, active, dense, factored, slope, factor, projected, held)
            factored += 1
        if not sound or not _newton(
            reducer[0],
            active,
            n_active,
            dense,
            n_dense,
            factor,
            projected,
            held,
            planar,
            spring,
            slope,
            miss,
            balance,
            right,
            tangent,
            step,
        ):
            break
        length = 1.0
        if n_active != before or pushed != (thrust[0] > 0.0):
            changes += 1
            length = 0.5 if changes > ALTERNATING else 1.0
        _move(motion, step, length, planar, spring, thrust)
        pulled = False
        for j in range(n_active):
            i = active[j]
            force[i] += length * miss[j]
            if force[i] <= 0.0:
                force[i] = 0.0
                pulled = True
        if pulled:
            n_active = _open_pulled(reducer, laws, gap, motion, force, active, n_active, dense, n_dense, elastic, depth)
            n_dense = _coupled(reducer[1], active, n_active, dense)
            factored = 0
    state[0], state[1] = n_active, 0
    return STEP_LIMIT, max(residual, 2 * ACCEPTED)


@algebraic_part
def _extrapolate(torques, t, state, active, motions, forces, motion, force):
    """Start of step t: the two or three steps before with the same contacts, continued to its torque.

    ``motions``, ``forces`` hold the solved steps; ``state[2]`` counts those with the contacts of the last one.
    """
    points = min(state[2], 3, t)
    if points < 2:
        return
    weight = np.empty(3)
    for p in range(points):
        weight[p] = 1.0
        for other in range(points):
            if other != p:
                weight[p] *= (torques[t] - torques[t - 1 - other]) / (torques[t - 1 - p] - torques[t - 1 - other])
    for d in range(motion.shape[0]):
        total = 0.0
        for p in range(points):
            total += weight[p] * motions[t - 1 - p, d]
        motion[d] = total
    for j in range(state[0]):
        i = active[j]
        total = 0.0
        for p in range(points):
            total += weight[p] * forces[t - 1 - p, i]
        if total > 0.0:
            force[i] = total


@entry
def _solve_batch(
    torques, output, gap, reducer, laws, planar, bearing, clearance, start, motion, force, iterations, residual
):
    """Every sample through its torques in order; the last four arrays are filled."""
    n_motions, n_contacts = reducer[0].shape
    thrust = np.zeros(1)
    work = (
        np.empty((n_contacts, n_contacts)),  # factor
        np.empty((n_motions, n_contacts)),  # projected
        np.empty((n_motions, n_motions)),  # held
        np.empty(n_contacts),  # elastic
        np.empty(n_contacts),  # depth
        np.empty(n_contacts),  # miss
        np.empty(n_contacts),  # slope
        np.empty(n_motions),  # balance
        np.empty(n_contacts),  # right
        np.empty((n_motions, n_motions)),  # tangent
        np.empty(n_motions),  # step
        np.zeros(8),  # spring
        thrust,
        np.empty(n_contacts, np.int64),  # dense
    )
    active = np.empty(n_contacts, np.int64)
    state = np.zeros(3, np.int64)  # active contacts, rows of the factor, solved steps with these contacts
    q, f = np.empty(n_motions), np.empty(n_contacts)
    for s in range(gap.shape[0]):
        q[:] = start[s]
        f[:] = 0.0
        thrust[0] = 0.0
        state[:] = 0
        for t in range(torques.shape[0]):
            _extrapolate(torques, t, state, active, motion[s], force[s], q, f)
            rise = torques[t] / torques[t - 1] if t > 0 else 1.0
            between = int(np.log(rise) / np.log(LARGEST_RISE)) if rise > LARGEST_RISE else 0
            iterations[s, t] = 0
            for part in range(between):  # on the way to a far torque, as far as it goes
                torque = torques[t - 1] * rise ** ((part + 1.0) / (between + 1.0))
                taken, _ = _newton_steps(
                    torque, output, gap[s], reducer, laws, planar, bearing, clearance[s], q, f, active, state, work
                )
                iterations[s, t] += taken
            taken, residual[s, t] = _newton_steps(
                torques[t], output, gap[s], reducer, laws, planar, bearing, clearance[s], q, f, active, state, work
            )
            iterations[s, t] += taken
            if residual[s, t] > ACCEPTED:
                state[0] = _interior(
                    torques[t], output, gap[s], reducer, laws, planar, bearing, clearance[s], q, f, active, work
                )
                state[1] = 0
                taken, residual[s, t] = _newton_steps(
                    torques[t], output, gap[s], reducer, laws, planar, bearing, clearance[s], q, f, active, state, work
                )
                iterations[s, t] += INTERIOR_STEPS + taken
            motion[s, t] = q
            force[s, t] = f
            same = t > 0
            for i in range(n_contacts):
                same = same and (f[i] > 0.0) == (force[s, t - 1, i] > 0.0)
            state[2] = state[2] + 1 if same else 1


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
    linear = bearing.exponent == 1 and not np.any(bearing_clearance)
    planar, free = reducer.closing[:, :2], reducer.closing[:, 2 if linear else 0 :]
    if linear:
        compliance = compliance + planar @ planar.T / bearing.stiffness
    n, n_contacts = gap.shape
    shape = (n, len(torque))
    motion, force = np.empty((*shape, free.shape[1])), np.empty((*shape, n_contacts))
    iterations, residual = np.empty(shape, np.int64), np.empty(shape)
    _solve_batch(
        np.asarray(torque, float),
        reducer.output_motion - (2 if linear else 0),
        np.ascontiguousarray(gap),
        (np.ascontiguousarray(free.T), np.ascontiguousarray(compliance)),
        (laws.linear, laws.logarithmic, laws.power, laws.exponent, laws.force_limit),
        not linear,
        (bearing.stiffness, bearing.exponent),
        np.ascontiguousarray(bearing_clearance, dtype=float),
        np.ascontiguousarray(start[:, 2 if linear else 0 :]),
        motion,
        force,
        iterations,
        residual,
    )
    if linear:
        motion = np.concatenate([-force @ planar / bearing.stiffness, motion], axis=2)
    residual[~np.all(np.isfinite(gap), axis=1)] = np.inf
    return Equilibria(motion, force, iterations, residual, residual <= ACCEPTED)
