"""A start for Newton where there is none: an interior-point iteration over all contacts (compiled parts)."""

import numpy as np

from pipeline.arrays import Real
from pipeline.model.compiled import algebraic_part, merged_part
from pipeline.model.equilibrium.blocks import Friction, System, Workspace, count, part_of
from pipeline.model.equilibrium.newton import activate, include_all, move, newton_step, renew, reset, share_of_a_turn
from pipeline.model.equilibrium.residual import deflect, force_at_penetration, law, residuals
from pipeline.model.equilibrium.return_mapping import share_of_braking

INTERIOR_STEPS = 80
"""Steps of the interior-point iteration that finds another start; about 30 are usual."""
INTERIOR_END = 1e-10
"""Complementarity, in units of load times stride, at which the interior point shows which contacts are closed."""
CENTRING = 0.1
"""Share of the complementarity that an interior-point step aims at."""
INTERIOR_SHARE = 0.95
"""Share of the way to the nearest force or slack of zero that a step may go."""


@algebraic_part
def _loads(system: System, torque: float, gap: Real) -> tuple[float, float]:
    """Force of a contact that carries the torque at the longest arm, and that or the largest of an interference [N]."""
    longest = 0.0
    for i in range(gap.shape[0]):
        longest = max(longest, abs(system.contact_jacobian[system.output, i]))
    load = abs(torque) / longest
    largest_load = load
    for i in range(gap.shape[0]):
        if gap[i] < 0.0:
            largest_load = max(largest_load, force_at_penetration(system, i, -gap[i]))
    return load, largest_load


@algebraic_part
def _stride(system: System, torque: float, load: float, gap: Real) -> float:
    """Largest sensible move of a contact [mm]: the widest gap and the deflection of one that carries all the load.

    A law that has no limit bears the ``load`` of the longest arm: at the arm's rounding it would have no bounds.
    """
    widest, deepest = 0.0, 0.0
    for i in range(gap.shape[0]):
        widest = max(widest, abs(gap[i]))
        arm = abs(system.contact_jacobian[system.output, i])
        if arm > 0.0:
            force = min(abs(torque) / arm, system.limit[i])
            force = load if np.isinf(system.limit[i]) else force
            local, _ = law(system, i, force)
            deepest = max(deepest, local + system.self_compliance[i] * force)
    return widest + deepest


@algebraic_part
def _length(work: Workspace) -> float:
    """Share of the step that keeps forces and slacks positive; their steps stand in ``miss`` and ``slope``."""
    length = 1.0
    for b in range(count(work.active)):
        part = part_of(work.active, work, b)
        for j in range(work.sizes[b, 0]):
            force = work.force[part.active[j]]
            if part.miss[j] < 0.0:
                length = min(length, -INTERIOR_SHARE * force / part.miss[j])
            if part.slope[j] < 0.0:
                length = min(length, -INTERIOR_SHARE * part.slack[j] / part.slope[j])
    return length


@algebraic_part
def _aim(complementarity: float, work: Workspace) -> None:
    """Let the contacts' tangents and misfits aim at a share of the complementarity."""
    for b in range(count(work.active)):
        part = part_of(work.active, work, b)
        active, slack, miss, slope = part.active, part.slack, part.miss, part.slope
        for j in range(work.sizes[b, 0]):
            slope[j] += slack[j] / work.force[active[j]]
            miss[j] -= CENTRING * complementarity / work.force[active[j]]


@algebraic_part
def _step_of_slacks(complementarity: float, work: Workspace) -> None:
    """Steps of the slacks into ``slope`` from those of the forces in ``miss``."""
    for b in range(count(work.active)):
        part = part_of(work.active, work, b)
        active, slack, miss, slope = part.active, part.slack, part.miss, part.slope
        for j in range(work.sizes[b, 0]):
            slope[j] = (CENTRING * complementarity - slack[j] * miss[j]) / work.force[active[j]] - slack[j]


@algebraic_part
def _go(length: float, work: Workspace) -> None:
    """Add a share of the step to forces and slacks."""
    for b in range(count(work.active)):
        part = part_of(work.active, work, b)
        for j in range(work.sizes[b, 0]):
            work.force[part.active[j]] += length * part.miss[j]
            part.slack[j] += length * part.slope[j]


@algebraic_part
def _complementarity(work: Workspace) -> float:
    """Mean of force times slack [N mm]."""
    total = 0.0
    for b in range(count(work.active)):
        part = part_of(work.active, work, b)
        for j in range(work.sizes[b, 0]):
            total += work.force[part.active[j]] * part.slack[j] / work.force.shape[0]
    return total


@algebraic_part
def _keep_closed(system: System, load: float, stride: float, work: Workspace) -> None:
    """Leave those contacts active whose force, over the load, is larger than their slack over the stride."""
    slack = work.depth
    for b in range(count(work.active)):
        part = part_of(work.active, work, b)
        for j in range(work.sizes[b, 0]):
            slack[part.active[j]] = part.slack[j]
    reset(work)
    for i in range(slack.shape[0]):
        if work.force[i] * stride > slack[i] * load:
            activate(system, i, work)
        else:
            work.force[i] = 0.0


@merged_part
def start_within(
    system: System, friction: Friction, torque: float, gap: Real, clearance: Real, work: Workspace
) -> None:
    """Near-solution from no start at all: its motions, forces and closed contacts in ``work``.

    ``torque`` [N mm] at the output, ``gap`` (n_contacts,) and ``clearance`` (n_disks,) of the bearings [mm].

    Force times slack tends to zero along the central path of the convex problem, which has no active set to guess.
    A disk that its bearing lets go is held where it is by a spring that vanishes with them (a proximal term: it slows
    the disk down and moves no solution).
    """
    load, largest_load = _loads(system, torque, gap)
    stride = _stride(system, torque, load, gap)
    work.thrust[:] = 0.0
    for d in range(work.motion.shape[0]):
        work.motion[d] = 0.0
    reset(work)
    for i in range(gap.shape[0]):
        activate(system, i, work)
        work.force[i] = largest_load
    work.slack[:] = stride
    for _ in range(INTERIOR_STEPS):
        deflect(system, gap, work)
        complementarity = _complementarity(work)
        residuals(system, friction, torque, clearance, work)
        if system.planar:
            for k in range(clearance.shape[0]):
                hold = np.sqrt(complementarity * largest_load / stride) / (stride + clearance[k])
                work.spring[k, 2] += hold
                work.spring[k, 4] += hold
        if complementarity < INTERIOR_END * load * stride:
            break
        _aim(complementarity, work)
        renew(work)
        if not include_all(system, work) or not newton_step(system, friction, work):
            break
        longest = min(share_of_a_turn(system, work), share_of_braking(system, friction, work))
        _step_of_slacks(complementarity, work)
        length = min(_length(work), longest)
        move(system, length, work)
        _go(length, work)
    _keep_closed(system, load, stride, work)
