"""Equilibria along a load history, with friction: contacts, sliders and motions at once.

Return mapping as in plasticity: a slider that would be pulled beyond its limit is held at it, and its anchor follows.
Source: Simo, Hughes, Computational Inelasticity (1998), ch. 1.
"""

from dataclasses import fields

import numpy as np

from pipeline.model.compiled import entry, part
from pipeline.model.equilibrium.newton import OPEN, REGULAR
from pipeline.model.equilibrium.residual import System, force_at_penetration, law
from pipeline.model.geometry.cycloid_profile import Real
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.return_mapping import anchor_on, slide

SETTLED = 1e-9
"""A step is solved when neither a deflection nor a balance is off by more than this share of its largest term."""
NEWTON_STEPS = 14
"""Newton steps of one increment before it is halved."""
UNDAMPED, DAMPED, PERIOD = 6, 3, 5
"""Newton steps after which sticking and slipping may alternate: of each so many further ones the first are halved, and
the others, whole, settle what these have found."""
HALVINGS = 4
"""A step that does not converge is reached in two, each of them again, up to this depth."""
DRAG = 5.0
"""Springs, in shares of the bearing's stiffness, that let the disk only crawl to where Newton does not find at once."""
CRAWLS = 12
"""Increments of the slow way at most."""
LOST = 1e-3
"""Relative residual of a step after which the path is not followed: its friction would start from nowhere."""
NO_TORQUE = 1e-7
"""Share of the largest torque that stands for none where there is play."""


@part
def _spring(system, clearance, x, y, spring):
    """Force (fx, fy) and tangent (kxx, kxy, kyy) of the bearing at the displacement (x, y)."""
    stiffness, exponent = system.stiffness, system.bearing_exponent
    spring[:] = 0.0
    distance = np.sqrt(x * x + y * y)
    depth = distance - clearance
    if depth <= 0.0:
        return
    push = stiffness * depth**exponent
    radial, across = exponent * push / depth, push / distance
    ux, uy = x / distance, y / distance
    spring[0], spring[1] = push * ux, push * uy
    spring[2] = radial * ux * ux + across * uy * uy
    spring[3] = (radial - across) * ux * uy
    spring[4] = radial * uy * uy + across * ux * ux


@part
def _misfits(system, gap, force, q, active, elastic, miss, slope):
    """Close penetrated contacts, list the active ones, and give their misfits of deflection and tangents.

    Returns the number of active contacts and the relative misfit.
    """
    jacobian, compliance = system.contact_jacobian, system.compliance
    n, n_active = gap.shape[0], 0
    largest, off = 1e-300, 0.0
    elastic[:] = 0.0
    for j in range(n):
        if force[j] > 0.0 and compliance[j, j] > 0.0:
            for i in range(n):
                elastic[i] += compliance[j, i] * force[j]
    for i in range(n):
        depth = -gap[i] - elastic[i]
        for d in range(q.shape[0]):
            depth += jacobian[d, i] * q[d]
        if force[i] == 0.0:
            if depth <= OPEN:
                continue
            miss[i] = -depth
            slope[i] = -1.0
        else:
            local, slope[i] = law(system, i, force[i])
            miss[i] = local - depth
            largest = max(largest, local + elastic[i])
            off = max(off, abs(miss[i]))
        active[n_active] = i
        n_active += 1
    for p in range(n_active):
        i = active[p]
        if slope[i] < 0.0:  # a new one
            depth = -miss[i]
            force[i] = force_at_penetration(system, i, depth)
            local, slope[i] = law(system, i, force[i])
            miss[i] = local + compliance[i, i] * force[i] - depth
            off = np.inf
    return n_active, off / largest


@part
def _add_contacts(system, force, active, columns, miss, slope, balance, scale, matrix, right):
    """Rows of the active contacts: the coupled ones stay unknowns, the others are eliminated into the motions.

    Returns the largest stiffness of a contact.
    """
    jacobian, compliance = system.contact_jacobian, system.compliance
    n_motions, first = balance.shape[0], matrix.shape[0] - balance.shape[0]
    stiffest = 0.0
    for i in active:
        stiffest = max(stiffest, 1.0 / slope[i])
        p = columns[i]
        for d in range(n_motions):
            term = jacobian[d, i] * force[i]
            balance[d] += term
            scale[d] += abs(term)
            if p >= 0:
                matrix[p, first + d] = -jacobian[d, i]
                matrix[first + d, p] += jacobian[d, i]
            else:
                right[first + d] += jacobian[d, i] * miss[i] / slope[i]
                for e in range(n_motions):
                    matrix[first + d, first + e] += jacobian[d, i] * jacobian[e, i] / slope[i]
        if p >= 0:
            for other in active:
                if columns[other] >= 0:
                    matrix[p, columns[other]] = compliance[i, other]
            matrix[p, p] += slope[i]
            right[p] = -miss[i]
    return stiffest


@part
def _equilibrium(torque, gap, system, clearance, sliders, anchor, q, force, drag, work):
    """Newton on contacts, sliders and motions from (q, force), changed in place; returns the relative residual.

    ``drag`` holds the motions where they start by springs of that share of the contacts' stiffness.
    """
    jacobian, output = system.contact_jacobian, system.output
    coupled, room, columns, elastic, miss, slope, balance, scale, spring = work
    n_motions = jacobian.shape[0]
    residual = np.inf
    start = q.copy()
    for iteration in range(NEWTON_STEPS):
        n_active, off = _misfits(system, gap, force, q, room, elastic, miss, slope)
        active = room[:n_active]
        columns[:] = -1
        first = 0
        for i in active:
            if coupled[i]:
                columns[i] = first
                first += 1
        matrix, right = np.zeros((first + n_motions, first + n_motions)), np.zeros(first + n_motions)
        tangent, below = matrix[first:, first:], matrix[first:, :first]
        balance[:] = 0.0
        balance[output] = -torque
        scale[:] = np.abs(balance)
        _spring(system, clearance, q[0], q[1], spring)
        balance[0] += spring[0]
        balance[1] += spring[1]
        tangent[0, 0], tangent[0, 1], tangent[1, 0], tangent[1, 1] = spring[2], spring[3], spring[3], spring[4]
        slide(sliders, jacobian[output], anchor, q, force, balance, scale, below, columns, tangent)
        stiffest = _add_contacts(system, force, active, columns, miss, slope, balance, scale, matrix, right)
        unbalanced = 0.0
        for d in range(n_motions):
            tangent[d, d] += REGULAR * max(stiffest, system.stiffness)
            if drag > 0.0:
                widest = np.max(np.abs(jacobian[d]))
                held = drag * system.stiffness * widest * widest
                balance[d] += held * (q[d] - start[d])
                tangent[d, d] += held
            right[first + d] -= balance[d]
            unbalanced = max(unbalanced, abs(balance[d]) / max(scale[d], 1e-300))
        residual = max(off, unbalanced)
        if residual <= SETTLED:
            return residual
        if not np.isfinite(np.sum(matrix)) or not np.isfinite(np.sum(right)):
            return np.inf
        step = np.linalg.solve(matrix, right)
        length = 0.5 if iteration >= UNDAMPED and (iteration - UNDAMPED) % PERIOD < DAMPED else 1.0
        for d in range(n_motions):
            q[d] += length * step[first + d]
        for i in active:
            if columns[i] >= 0:
                change = step[columns[i]]
            else:
                change = -miss[i]
                for d in range(n_motions):
                    change += jacobian[d, i] * step[first + d]
                change /= slope[i]
            force[i] = max(force[i] + length * change, 0.0)
    return residual


@part
def _crawl(goal, gap, system, clearance, sliders, anchor, q, force, work):
    """Equilibrium by way of states that springs hold near the ones before; returns its relative residual."""
    residual = np.inf
    for _ in range(CRAWLS):
        _equilibrium(goal, gap, system, clearance, sliders, anchor, q, force, DRAG, work)
        free_q, free_force = q.copy(), force.copy()
        residual = _equilibrium(goal, gap, system, clearance, sliders, anchor, free_q, free_force, 0.0, work)
        if residual <= SETTLED:
            q[:], force[:] = free_q, free_force
            break
    return residual


@entry
def _follow(torques, gap, system, clearance, sliders, nodes, seed_q, seed_force, q_out, f_out):
    """States of one sample along its history; returns the largest residual. ``nodes`` are the seeds' torques."""
    n_motions, n = system.contact_jacobian.shape
    n_sliders = sliders[1].shape[0]
    coupled = np.zeros(n, np.bool_)
    for i in range(n):
        coupled[i] = system.compliance[i, i] > 0.0
    for s in range(n_sliders):
        if sliders[4][s] >= 0:
            coupled[sliders[4][s]] = True
        elif sliders[3][s] > 0.0:
            coupled[:] = True
    work = (
        coupled,
        np.empty(n, np.int64),
        np.empty(n, np.int64),
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.empty(n_motions),
        np.empty(n_motions),
        np.zeros(5),
    )
    anchor, q, force = np.zeros(n_sliders), np.zeros(n_motions), np.zeros(n)
    trial_q, trial_force = np.empty(n_motions), np.empty(n)
    reached, worst = 0.0, 0.0
    for t in range(torques.shape[0]):
        share, depth = 1.0, 0  # of what is left of the way to this torque
        while True:
            goal = reached + share * (torques[t] - reached)
            across = goal * reached <= 0.0  # the play: the state before leads nowhere, if nothing sticks
            residual = np.inf
            for attempt in range(2):
                if across == (attempt == 0):
                    seed = np.argmin(np.abs(nodes - goal))
                    trial_q[:], trial_force[:] = seed_q[seed], seed_force[seed]
                else:
                    trial_q[:], trial_force[:] = q, force
                residual = _equilibrium(goal, gap, system, clearance, sliders, anchor, trial_q, trial_force, 0.0, work)
                if residual <= SETTLED:
                    break
            if not residual <= SETTLED and depth == HALVINGS:
                trial_q[:], trial_force[:] = q, force
                residual = _crawl(goal, gap, system, clearance, sliders, anchor, trial_q, trial_force, work)
            if not residual <= SETTLED and depth < HALVINGS:
                share, depth = 0.5 * share, depth + 1
                continue
            if not residual <= LOST:
                q_out[t:], f_out[t:] = np.nan, np.nan
                return np.inf
            q[:], force[:] = trial_q, trial_force
            anchor_on(sliders, system.contact_jacobian[system.output], anchor, q, force)
            worst = max(worst, residual)
            reached = goal
            if share == 1.0:
                break
            share = min(1.0, 2.0 * share)
        q_out[t], f_out[t] = q, force
    return worst


def _off_zero(torques: Real, least: float) -> Real:
    """The torques, those of less than ``least`` after a larger one at ``least`` on its side."""
    last = np.maximum.accumulate(np.where(np.abs(torques) >= least, np.arange(len(torques)), -1))
    small = (np.abs(torques) < least) & (last >= 0)
    return np.where(small, np.copysign(least, torques[np.maximum(last, 0)]), torques)


def solve_path(drive: Drive, state: int, torques: Real, seeds: tuple[Real, Real, Real]) -> tuple[Real, Real, float]:
    """Motions (n_steps, n_motions), forces (n_steps, n_contacts) and largest relative residual along a history.

    Parameters
    ----------
    state : of the drive, which is followed.
    torques : (n_steps,) [N mm] in time order, from rest without force; zero after a load stands for the limit from its
        side, since in the play no force holds the pose.
    seeds : torques (n_nodes,), motions (n_nodes, n_motions), forces (n_nodes, n_contacts) of frictionless states, from
        which a step starts where the one before leads nowhere: across the play.

    Notes
    -----
    Newton on active contacts, sticking and slipping sliders and motions; a step that does not converge is
    halved. A residual above 1e-9 says that some step did not; beyond ``LOST`` it is infinite, and what follows NaN.
    """
    reducer, laws, bearing = drive.reducer, drive.laws, drive.bearing
    sliders, gap = drive.sliders.acting, drive.gap[state]
    motion, force = np.empty((len(torques), reducer.contact_jacobian.shape[1])), np.empty((len(torques), len(gap)))
    system = System(
        np.ascontiguousarray(reducer.contact_jacobian.T),
        np.ascontiguousarray(drive.compliance),
        *(laws.linear, laws.logarithmic, laws.power, laws.exponent, laws.force_limit),
        reducer.output_motion,
        True,
        float(bearing.stiffness),
        float(bearing.exponent),
    )
    worst = _follow(
        _off_zero(np.asarray(torques, float), NO_TORQUE * float(np.max(np.abs(seeds[0])))),
        np.ascontiguousarray(gap),
        system,
        float(drive.bearing_clearance[state]),
        tuple(np.ascontiguousarray(getattr(sliders, f.name)) for f in fields(sliders)),
        *(np.ascontiguousarray(one) for one in seeds),
        motion,
        force,
    )
    return motion, force, worst
