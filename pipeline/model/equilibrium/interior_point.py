"""A start for Newton where there is none: an interior-point iteration over all contacts (compiled parts)."""

import numpy as np

from pipeline.model.compiled import algebraic_part
from pipeline.model.equilibrium.newton import activate, include_all, move, newton_step, reset, share_of_a_turn
from pipeline.model.equilibrium.residual import deflect, force_at_penetration, law, residuals
from pipeline.model.equilibrium.return_mapping import share_of_braking

INTERIOR_STEPS = 80
"""Steps of the interior-point iteration that finds another start; about 30 are usual."""
INTERIOR_END = 1e-10
"""Complementarity, in units of load times stride, at which the interior point shows which contacts are closed."""
CENTRING = 0.1
"""Share of the complementarity that an interior-point step aims at."""
WITHIN = 0.95
"""Share of the way to the nearest force or slack of zero that a step may go."""


@algebraic_part
def _stride(system, torque, gap):
    """Largest sensible move of a contact [mm]: the widest gap and the deflection of one that carries all the load."""
    widest, deepest = 0.0, 0.0
    for i in range(gap.shape[0]):
        widest = max(widest, abs(gap[i]))
        arm = abs(system.contact_jacobian[system.output, i])
        if arm > 0.0:
            force = min(abs(torque) / arm, system.limit[i])
            local, _ = law(system, i, force)
            deepest = max(deepest, local + system.compliance[i, i] * force)
    return widest + deepest


@algebraic_part
def _loads(system, torque, gap):
    """Force of a contact that carries the torque at the longest arm, and that or the largest of an interference [N]."""
    longest = 0.0
    for i in range(gap.shape[0]):
        longest = max(longest, abs(system.contact_jacobian[system.output, i]))
    load = abs(torque) / longest
    largest = load
    for i in range(gap.shape[0]):
        if gap[i] < 0.0:
            largest = max(largest, force_at_penetration(system, i, -gap[i]))
    return load, largest


@algebraic_part
def _length(work):
    """Share of the step that keeps forces and slacks positive; their steps stand in ``miss`` and ``slope``."""
    length = 1.0
    for j in range(work.slack.shape[0]):
        if work.miss[j] < 0.0:
            length = min(length, -WITHIN * work.force[work.active[j]] / work.miss[j])
        if work.slope[j] < 0.0:
            length = min(length, -WITHIN * work.slack[j] / work.slope[j])
    return length


@algebraic_part
def start_within(system, friction, torque, gap, clearance, work):
    """Near-solution from no start at all: its motions, forces and closed contacts in ``work``.

    Force times slack tends to zero along the central path of the convex problem, which has no active set to guess.
    A disk that its bearing lets go is held where it is by a spring that vanishes with them (a proximal term: it slows
    the disk down and moves no solution).
    """
    active, force, miss, slope, slack = work.active, work.force, work.miss, work.slope, work.slack
    n = gap.shape[0]
    stride = _stride(system, torque, gap)
    load, largest = _loads(system, torque, gap)
    work.thrust[0] = 0.0
    for d in range(work.motion.shape[0]):
        work.motion[d] = 0.0
    reset(work)
    for i in range(n):
        activate(system, i, work)
        force[i], slack[i] = largest, stride
    for _ in range(INTERIOR_STEPS):
        deflect(system, gap, work)
        complementarity = 0.0
        for j in range(n):
            complementarity += force[active[j]] * slack[j] / n
        residuals(system, friction, torque, clearance, work)
        if system.planar:
            hold = np.sqrt(complementarity * largest / stride) / (stride + clearance)
            work.spring[2] += hold
            work.spring[4] += hold
        if complementarity < INTERIOR_END * load * stride:
            break
        for j in range(n):
            slope[j] += slack[j] / force[active[j]]
            miss[j] -= CENTRING * complementarity / force[active[j]]
        work.counts[2] = 0
        if not include_all(system, work) or not newton_step(system, friction, work):
            break
        longest = share_of_a_turn(system, work)
        if friction is not None:
            longest = min(longest, share_of_braking(system, friction, work))
        for j in range(n):
            slope[j] = (CENTRING * complementarity - slack[j] * miss[j]) / force[active[j]] - slack[j]
        length = min(_length(work), longest)
        move(system, length, work)
        for j in range(n):
            force[active[j]] += length * miss[j]
            slack[j] += length * slope[j]
    for j in range(n):
        slope[active[j]] = slack[j]
    reset(work)
    for i in range(n):
        if force[i] * stride > slope[i] * load:
            activate(system, i, work)
        else:
            force[i] = 0.0
