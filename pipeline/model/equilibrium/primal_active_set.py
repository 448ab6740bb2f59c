"""The last steps to an equilibrium from an interior point: a primal active set (compiled parts).

Newton's active set (``newton``) closes every penetrated contact and opens every one that would pull at once. That is
fast where contacts hardly feel each other, and may alternate for ever where a soft body couples them. Here the forces
stay positive and the energy falls (of linear laws exactly, and ours are nearly linear): a step
ends where the first force vanishes, that contact opens, and only at the
least energy of the closed contacts is another one closed, the most penetrated. No set of closed contacts can come
twice, so the iteration ends (Nocedal, Wright, Numerical Optimization (2006), ch. 16.5). Where the closed contacts leave
a body free to move and the load moves it, the first open contact on its way is closed. It changes one contact at a
time, so it wants a start near the solution.
"""

import numpy as np

from pipeline.arrays import Real
from pipeline.model.compiled import algebraic_part, borrowing_entry, merged_part
from pipeline.model.equilibrium.blocks import Friction, System, Workspace, count, part_of
from pipeline.model.equilibrium.interior_point import INTERIOR_STEPS, start_within
from pipeline.model.equilibrium.newton import (
    ACCEPTED_RESIDUAL,
    BALANCE_TOLERANCE,
    FORCE_TOLERANCE,
    OPEN_DEPTH,
    ROUNDING,
    activate,
    advance,
    include_all,
    move,
    newton_step,
    release,
    renew,
    share_of_a_turn,
)
from pipeline.model.equilibrium.residual import deflect, force_at_penetration, residuals
from pipeline.model.equilibrium.return_mapping import share_of_braking

SETTLING_STEPS = 300
"""Newton steps before it is given up; a contact that is added takes about three."""
ENTRY = 1e-6
"""Force of a contact that is added, over the one that would close it alone: it disturbs the others by no more."""
STALLED = 0.5
"""Share of what was unbalanced that is left after a full step where no closed contact holds a body."""


@algebraic_part
def _most_penetrated(work: Workspace) -> int:
    """Open contact with the largest penetration, -1 if there is none."""
    depth, force = work.depth, work.force
    deepest, contact = OPEN_DEPTH, -1
    for i in range(depth.shape[0]):
        if force[i] == 0.0 and depth[i] > deepest:
            deepest, contact = depth[i], i
    return contact


@algebraic_part
def _step_to_the_first_zero(longest: float, work: Workspace) -> float:
    """Share of the step, at most ``longest``, at which the first active force vanishes; it becomes exactly 0."""
    force, length = work.force, longest
    for b in range(count(work.active)):
        part = part_of(work.active, work, b)
        active, miss = part.active, part.miss
        for j in range(work.sizes[b, 0]):
            if force[active[j]] + miss[j] < 0.0:
                length = min(length, -force[active[j]] / miss[j])
    for b in range(count(work.active)):
        part = part_of(work.active, work, b)
        active, miss = part.active, part.miss
        for j in range(work.sizes[b, 0]):
            if force[active[j]] + length * miss[j] <= 1e-14 * force[active[j]]:
                force[active[j]], miss[j] = 0.0, 0.0
    return length


@algebraic_part
def _close_first_on_the_way(system: System, work: Workspace) -> bool:
    """Go on along the step of the motions until an open contact touches, and close it; false if none would."""
    step, shortest, contact = work.step, np.inf, -1
    for i in range(work.force.shape[0]):
        if work.force[i] > 0.0:
            continue
        rate = 0.0
        for d in range(step.shape[0]):
            rate += system.contact_jacobian[d, i] * step[d]
        if rate > 0.0 and -work.depth[i] < shortest * rate:
            shortest, contact = -work.depth[i] / rate, i
    if contact < 0:
        return False
    move(system, max(shortest, 0.0), work)
    work.force[contact] = ENTRY * force_at_penetration(system, contact, OPEN_DEPTH)
    activate(system, contact, work)
    return True


@merged_part
def settle(
    system: System, friction: Friction, torque: float, gap: Real, clearance: Real, work: Workspace
) -> tuple[int, float]:
    """Primal active set from the state in ``work``, which is changed; returns the iterations and the residual.

    ``torque`` [N mm] at the output, ``gap`` (n_contacts,) and ``clearance`` (n_disks,) of the bearings [mm].
    """
    residual, steps_since, before = 1.0, 0, np.inf
    for iteration in range(SETTLING_STEPS):
        deflect(system, gap, work)
        deviation, imbalance = residuals(system, friction, torque, clearance, work)
        residual = max(deviation, imbalance)
        steps_since += 1
        if (deviation <= FORCE_TOLERANCE and imbalance <= BALANCE_TOLERANCE) or (
            steps_since > ROUNDING and residual <= ACCEPTED_RESIDUAL
        ):
            contact = _most_penetrated(work)
            if contact < 0:
                return iteration, residual
            work.force[contact] = ENTRY * force_at_penetration(system, contact, work.depth[contact])
            activate(system, contact, work)
            steps_since, before = 0, np.inf
            continue
        is_free = deviation <= FORCE_TOLERANCE and imbalance > STALLED * before and not system.planar
        before = imbalance
        renew(work)
        if not include_all(system, work) or not newton_step(system, friction, work):
            break
        if is_free and imbalance > ACCEPTED_RESIDUAL:
            if not _close_first_on_the_way(system, work):
                break
            steps_since, before = 0, np.inf
            continue
        length = min(share_of_a_turn(system, work), share_of_braking(system, friction, work))
        length = _step_to_the_first_zero(length, work)
        move(system, length, work)
        advance(length, work)
        release(system, work)
    renew(work)
    return SETTLING_STEPS, max(residual, 2 * ACCEPTED_RESIDUAL)


@borrowing_entry
def solved_afresh(
    system: System, friction: Friction, torque: float, gap: Real, clearance: Real, work: Workspace
) -> tuple[int, float]:
    """Solve a load step that Newton does not solve, from an interior point, into ``work``; iterations and residual.

    ``torque`` [N mm] at the output, ``gap`` (n_contacts,) and ``clearance`` (n_disks,) of the bearings [mm].

    It is an entry point of its own: the loop over load steps is compiled without it, and faster for that. It is seldom
    run, so one form is compiled for all reducers: ``work`` is ``with_axis_of_blocks``, and ``friction`` has no slider
    where there is none.
    """
    start_within(system, friction, torque, gap, clearance, work)
    n_updates, residual = settle(system, friction, torque, gap, clearance, work)
    return n_updates + INTERIOR_STEPS, residual
