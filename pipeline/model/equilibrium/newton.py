"""Newton's iteration on the active contacts of one load step (compiled parts)."""

import numpy as np

from pipeline.arrays import Real
from pipeline.model.compiled import algebraic_part, merged_part
from pipeline.model.equilibrium.blocks import Friction, System, Workspace, count, moves, part_of
from pipeline.model.equilibrium.inverse_update import exclude, include, product, solve_positive_tangent, solve_tangent
from pipeline.model.equilibrium.residual import add_deflection, deflect, force_at_penetration, residuals
from pipeline.model.equilibrium.return_mapping import add_friction, share_of_braking

FORCE_TOLERANCE = 1e-10
"""A step is solved when no active contact's deflection is off by more than this share of the largest one ..."""
BALANCE_TOLERANCE = 1e-12
"""... and no rigid motion's balance by more than this share of the sum of its terms."""
ACCEPTED_RESIDUAL = 1e-9
"""A step that ends above this residual (of either kind) is a failed one."""
STEP_LIMIT = 60
"""Newton steps from one start before it is given up."""
ROUNDING = 30
"""Newton steps after which ``ACCEPTED_RESIDUAL`` is enough: near no load the disk's way beyond the bearing's clearance
is a difference whose rounding alone unbalances it."""
PATIENCE = 2.5
"""Steps with an old inverse that cost as much as a new one, which needs about two."""
REGULAR = 1e-9
"""Share of the mean contact stiffness that keeps a motion solvable that nothing holds at the moment."""
LARGEST_TURN = 0.5
"""Angle [rad] around the bearing beyond which the edge of its clearance is no arc of the second order any more."""
OPEN_DEPTH = 1e-13
"""Penetration [mm] below which an open contact is not added; rounding of positions near 1e2 mm."""
LEAST_PULL = -1e-300
"""Force [N] of an active contact whose force is 0, which would count as open: it is about to be released."""


@algebraic_part
def reset(work: Workspace) -> None:
    """Leave no contact active."""
    work.counts[:] = 0
    work.sizes[:] = 0


@algebraic_part
def activate(system: System, i: int, work: Workspace) -> None:
    """Make contact i active: the last of those of its block that elastic bodies couple, or the last of all of them."""
    b = system.block[i]
    sizes, active = work.sizes[b], part_of(work.active, work, b).active
    slot = sizes[0]
    if system.self_compliance[i] > 0.0:
        active[sizes[0]] = active[sizes[1]]
        slot = sizes[1]
        sizes[1] += 1
    active[slot] = i
    sizes[0] += 1


@algebraic_part
def _deactivate(system: System, b: int, p: int, work: Workspace) -> None:
    """Take the active contact at position p of a block out; the last one of its kind takes its place."""
    sizes, active = work.sizes[b], part_of(work.active, work, b).active
    if p < sizes[2]:
        exclude(system, b, p, work)
        active[p] = active[sizes[2]]
        p = sizes[2]
    if p < sizes[1]:
        sizes[1] -= 1
        active[p] = active[sizes[1]]
        p = sizes[1]
    sizes[0] -= 1
    active[p] = active[sizes[0]]


@algebraic_part
def renew(work: Workspace) -> None:
    """Leave no contact in the inverse."""
    work.sizes[:, 2] = 0


@algebraic_part
def _close_penetrated(system: System, work: Workspace) -> int:
    """Make every penetrated open contact active, with the force that closes it alone; returns their number.

    Penetrations are those at the end of the step, forces that pull included. Released first, these would unload the
    bodies one-sidedly and let others penetrate: of preloaded units the two sets alternated for ever.
    """
    depth, force = work.depth, work.force
    n_closed = 0
    for i in range(depth.shape[0]):
        n_closed += (depth[i] > OPEN_DEPTH) & (force[i] == 0.0)
    if n_closed == 0:
        return 0
    column = work.column  # judged before any of them deflects the others
    for i in range(depth.shape[0]):
        column[i] = depth[i]
    for i in range(depth.shape[0]):
        if column[i] > OPEN_DEPTH and force[i] == 0.0:
            force[i] = force_at_penetration(system, i, column[i])
            activate(system, i, work)
            if system.self_compliance[i] > 0.0:
                add_deflection(system, i, work)
    return n_closed


@algebraic_part
def release(system: System, work: Workspace) -> int:
    """Open the active contacts that pull, and take back what they deflect; returns their number."""
    force, n_opened = work.force, 0
    for b in range(count(work.active)):
        active = part_of(work.active, work, b).active
        for p in range(work.sizes[b, 0] - 1, -1, -1):
            i = active[p]
            if force[i] > 0.0:
                continue
            force[i] = -force[i]
            if system.self_compliance[i] > 0.0:
                add_deflection(system, i, work)
            force[i] = 0.0
            _deactivate(system, b, p, work)
            n_opened += 1
    return n_opened


@algebraic_part
def advance(length: float, work: Workspace) -> None:
    """Add a share of the step to the active forces, which may pull until they are released; none is 0."""
    force = work.force
    for b in range(count(work.active)):
        part = part_of(work.active, work, b)
        active, miss = part.active, part.miss
        for j in range(work.sizes[b, 0]):
            new_force = force[active[j]] + length * miss[j]
            force[active[j]] = new_force if new_force != 0.0 else LEAST_PULL


@algebraic_part
def _condense(system: System, b: int, work: Workspace) -> None:
    """Add what the active contacts of a block push on the motions to ``step``, and hold of them to ``tangent``.

    H^-1 miss of the coupled ones into ``inside``.
    """
    part = part_of(work.active, work, b)
    active, miss, slope = part.active, part.miss, part.slope
    jacobian, step, tangent = system.contact_jacobian, work.step, work.tangent
    n, n_coupled = work.sizes[b, 0], work.sizes[b, 1]
    product(part.inverse, n_coupled, miss, part.inside)
    for d in range(step.shape[0]):
        if not moves(work.active, system.moving[b], d):
            continue
        row, pull = part.projection[d], jacobian[d]
        total = step[d]
        for p in range(n_coupled):
            total += row[p] * miss[p]
        for j in range(n_coupled, n):
            total += pull[active[j]] * miss[j] / slope[j]
        step[d] = total
        for e in range(d + 1):
            total = tangent[d, e]
            for j in range(n_coupled, n):
                total += pull[active[j]] * jacobian[e, active[j]] / slope[j]
            tangent[d, e] = total


@algebraic_part
def _expand(system: System, b: int, work: Workspace) -> None:
    """Steps of the active forces of a block into ``miss``, once those of the motions are known."""
    part = part_of(work.active, work, b)
    active, miss, slope = part.active, part.miss, part.slope
    n, n_coupled, right_sides = work.sizes[b, 0], work.sizes[b, 1], part.inside
    for p in range(n_coupled):
        miss[p] = -right_sides[p]
    for j in range(n_coupled, n):
        miss[j] = -miss[j] / slope[j]
    for d in range(work.step.shape[0]):
        if not moves(work.active, system.moving[b], d):
            continue
        row, pull, q = part.projection[d], system.contact_jacobian[d], work.step[d]
        for p in range(n_coupled):
            miss[p] += row[p] * q
        for j in range(n_coupled, n):
            miss[j] += pull[active[j]] * q / slope[j]


@algebraic_part
def newton_step(system: System, friction: Friction | None, work: Workspace) -> bool:
    """Newton step: of the motions in ``step``, of the active forces in ``miss``; false if singular.

    (jacobian^T H^-1 jacobian + bearing) dq = jacobian^T H^-1 miss - balance;  H dF = jacobian dq - miss. Friction adds
    its own: see ``add_friction``.
    """
    step, tangent, balance, held_rows = work.step, work.tangent, work.balance, work.schur
    for d in range(step.shape[0]):
        step[d] = -balance[d]
        for e in range(d + 1):
            tangent[d, e] = held_rows[d, e]
    for b in range(count(work.active)):
        _condense(system, b, work)
    if system.planar:
        for k in range(work.thrust.shape[0]):
            tangent[2 * k, 2 * k] += work.spring[k, 2]
            tangent[2 * k + 1, 2 * k] += work.spring[k, 3]
            tangent[2 * k + 1, 2 * k + 1] += work.spring[k, 4]
    if friction is not None:
        add_friction(system, friction, work)
    stiffest = 0.0
    for d in range(step.shape[0]):
        stiffest = max(stiffest, tangent[d, d])
    for d in range(step.shape[0]):
        tangent[d, d] += REGULAR * stiffest
    if not (solve_positive_tangent(tangent, step) if friction is None else solve_tangent(tangent, step)):
        return False
    for b in range(count(work.active)):
        _expand(system, b, work)
    return True


@algebraic_part
def _move_around_edge(length: float, k: int, work: Workspace) -> None:
    """Move a disk's centre by a share of the step, around the edge of its bearing's clearance where it leans on it.

    A straight step along the edge would press the disk into the bearing by the square of the step.
    """
    motion = work.motion[2 * k : 2 * k + 2]
    x, y = motion[0], motion[1]
    along, aside = length * work.step[2 * k], length * work.step[2 * k + 1]
    distance = np.sqrt(x * x + y * y)
    radial, across = (along * x + aside * y) / distance, (aside * x - along * y) / distance
    if distance + radial > 0.5 * distance:
        angle, stretch = across / distance, (distance + radial) / distance
        motion[0] = stretch * (np.cos(angle) * x - np.sin(angle) * y)
        motion[1] = stretch * (np.sin(angle) * x + np.cos(angle) * y)
    else:
        motion[0] += along
        motion[1] += aside


@algebraic_part
def share_of_a_turn(system: System, work: Workspace) -> float:
    """Share of the step, at most 1, that takes no disk more than ``LARGEST_TURN`` around its bearing."""
    share = 1.0
    if not system.planar:
        return share
    for k in range(work.thrust.shape[0]):
        if work.thrust[k] == 0.0:
            continue
        x, y = work.motion[2 * k], work.motion[2 * k + 1]
        turn = abs(work.step[2 * k + 1] * x - work.step[2 * k] * y) / (x * x + y * y)
        share = min(share, LARGEST_TURN / turn) if turn > LARGEST_TURN else share
    return share


@algebraic_part
def move(system: System, length: float, work: Workspace) -> None:
    """Add a share of the step to the motions and to the bearings' thrusts, which end where they would pull."""
    thrust, step, motion = work.thrust, work.step, work.motion
    straight = 0
    if system.planar:
        for k in range(thrust.shape[0]):
            spring = work.spring[k]
            if thrust[k] > 0.0:
                rise = spring[5] * step[2 * k] + spring[6] * step[2 * k + 1] + spring[7]
                thrust[k] = max(thrust[k] + length * rise, 0.0)
                _move_around_edge(length, k, work)
            else:
                motion[2 * k] += length * step[2 * k]
                motion[2 * k + 1] += length * step[2 * k + 1]
        straight = 2 * thrust.shape[0]
    for d in range(straight, step.shape[0]):
        motion[d] += length * step[d]


@algebraic_part
def include_all(system: System, work: Workspace) -> bool:
    """Bring every coupled active contact into the inverse; false if nothing holds the bodies, or not positive."""
    sizes, holding, n_included = work.sizes, work.counts[1], 0
    for b in range(sizes.shape[0]):
        holding += sizes[b, 0]
        n_included += sizes[b, 2]
    if n_included == 0:
        work.schur[:] = 0.0
    if holding == 0:
        return False
    for b in range(sizes.shape[0]):
        while sizes[b, 2] < sizes[b, 1]:
            if not include(system, b, work):
                return False
    return True


@algebraic_part
def _worth_renewing(residual: float, previous: float) -> bool:
    """Whether the old inverse would need more than ``PATIENCE`` further steps, at the rate of the last one."""
    return residual >= previous or (residual / FORCE_TOLERANCE) > (previous / residual) ** PATIENCE


@merged_part
def converge(
    system: System, friction: Friction | None, torque: float, gap: Real, clearance: Real, work: Workspace
) -> tuple[int, float]:
    """Active-set Newton from the state in ``work``, which is changed; returns the iterations and the residual.

    ``torque`` [N mm] at the output, ``gap`` (n_contacts,) and ``clearance`` (n_disks,) of the bearings [mm].
    """
    previous, residual = np.inf, np.inf
    for iteration in range(STEP_LIMIT):
        deflect(system, gap, work)
        n_closed = _close_penetrated(system, work)
        n_changed = n_closed + release(system, work)
        deviation, imbalance = residuals(system, friction, torque, clearance, work)
        residual = max(deviation, imbalance)
        if n_changed == 0 and deviation <= FORCE_TOLERANCE and imbalance <= BALANCE_TOLERANCE:
            return iteration, residual
        if n_changed == 0 and iteration >= ROUNDING and residual <= ACCEPTED_RESIDUAL:
            return iteration, residual
        if n_closed == 0 and _worth_renewing(residual, previous):
            renew(work)
        previous = residual
        if not include_all(system, work) or not newton_step(system, friction, work):
            break
        length = 1.0 if friction is None else share_of_braking(system, friction, work)
        move(system, length, work)
        advance(length, work)
    renew(work)
    return STEP_LIMIT, max(residual, 2 * ACCEPTED_RESIDUAL)
