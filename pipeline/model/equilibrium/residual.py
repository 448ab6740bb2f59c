"""The equations of a load step, and what is off in them at given forces and motions (compiled parts).

Active contacts are those that may carry force. Contacts that elastic bodies couple form a block (``blocks``): each has
its own range of the contacts, and in ``Workspace.active`` its own list of them, the coupled ones first.
"""

import numpy as np

from pipeline.arrays import Real, Whole
from pipeline.model.compiled import algebraic_part, merged_part
from pipeline.model.equilibrium.blocks import Friction, System, Workspace, count, deflections_of, moves, part_of
from pipeline.model.equilibrium.return_mapping import resist

EXPONENT_BITS, EXPONENT_BIAS = 52, 1023
"""Place and bias of the exponent in a double (IEEE 754)."""
FRACTION, ONE = (1 << 52) - 1, 1023 << 52
"""Parts of a binary number of 64 bits, and the bits of 1.0."""
IDLE = 1e-3
"""Share of the largest force, of the torque at the longest arm or of a contact, below which what is unbalanced of a
body is told as a share of that: ``newton.BALANCE_TOLERANCE`` of it is the rounding of the largest force. A disk that
others leave without load has a force of rounding alone, all of which is unbalanced."""


@algebraic_part
def law(system: System, i: int, force: float) -> tuple[float, float]:
    """Local deflection and compliance of the closed contact i."""
    inner_force = min(force, system.limit[i])
    log = np.log(inner_force)
    deflection = inner_force * (system.linear[i] - system.logarithmic[i] * log)
    slope = system.linear[i] - system.logarithmic[i] * (1.0 + log)
    if system.power[i] > 0.0:
        power_part = system.power[i] * inner_force ** (system.exponent[i] - 1.0)
        deflection += inner_force * power_part
        slope += system.exponent[i] * power_part
    return deflection + (force - inner_force) * slope, slope


@algebraic_part
def force_at_penetration(system: System, i: int, penetration: float) -> float:
    """Force of contact i alone, with law(F) + C_ii F = penetration, to a few per cent: a start for Newton."""
    self_compliance = system.self_compliance[i]
    force: float = penetration / (self_compliance + abs(system.linear[i]) + system.logarithmic[i] + system.power[i])
    for _ in range(6):
        deflection, slope = law(system, i, force)
        force = max(
            0.1 * force, force + (penetration - deflection - self_compliance * force) / (slope + self_compliance)
        )
    return force


@merged_part
def bearing_springs(system: System, clearance: Real, work: Workspace) -> None:
    """Force and tangent of each bearing into ``spring``: fx, fy, kxx, kxy, kyy, and how the thrust follows the motion.

    ``clearance`` (n_disks,) [mm].

    A bearing pushes with the unknown ``thrust`` along the displacement u of its disk, like a contact:
    |d| - clearance - (thrust/K)^(1/n) = 0 is linearised with it, so that the disk can run around the edge of the
    clearance under a small force.
    """
    work.spring[:] = 0.0
    for k in range(clearance.shape[0]):
        _bearing_spring(system, clearance[k], k, work)


@merged_part
def _bearing_spring(system: System, clearance: float, k: int, work: Workspace) -> None:
    thrust, spring = work.thrust, work.spring[k]
    x, y = work.motion[2 * k], work.motion[2 * k + 1]
    if clearance == 0.0 and system.bearing_exponent == 1.0:
        thrust[k] = 0.0  # it follows from the motions, which need not go around
        spring[0], spring[1] = system.stiffness * x, system.stiffness * y
        spring[2], spring[4] = system.stiffness, system.stiffness
        return
    distance = np.sqrt(x * x + y * y)
    if thrust[k] == 0.0 and distance > clearance:
        thrust[k] = system.stiffness * (distance - clearance) ** system.bearing_exponent
    if thrust[k] == 0.0 or distance == 0.0:
        thrust[k] = 0.0
        return
    depth = (thrust[k] / system.stiffness) ** (1.0 / system.bearing_exponent)
    radial, across = system.bearing_exponent * thrust[k] / depth, thrust[k] / distance
    ux, uy = x / distance, y / distance
    miss = distance - clearance - depth
    push = thrust[k] + radial * miss
    spring[0], spring[1] = push * ux, push * uy
    spring[2] = radial * ux * ux + across * uy * uy
    spring[3] = (radial - across) * ux * uy
    spring[4] = radial * uy * uy + across * ux * ux
    spring[5], spring[6], spring[7] = radial * ux, radial * uy, radial * miss


@algebraic_part
def add_deflection(system: System, i: int, work: Workspace) -> None:
    """Add the elastic deflection by contact i alone to that of every contact of its block."""
    b = system.block[i]
    row, f = system.compliance[i], work.force[i]
    elastic, depth = deflections_of(work.active, work, system.blocks[b])
    for k in range(elastic.shape[0]):
        elastic[k] += row[k] * f
    for k in range(elastic.shape[0]):
        depth[k] -= row[k] * f


@algebraic_part
def _bend(system: System, b: int, work: Workspace) -> None:
    """Elastic deflection of the contacts of a block by its active ones."""
    part = part_of(work.active, work, b)
    compliance, force, active, n_coupled = system.compliance, work.force, part.active, work.sizes[b, 1]
    elastic = deflections_of(work.active, work, system.blocks[b]).elastic
    for k in range(elastic.shape[0]):
        elastic[k] = 0.0
    for p in range(0, n_coupled - 1, 2):  # two at once save half of the stores
        row, f = compliance[active[p]], force[active[p]]
        contact, g = compliance[active[p + 1]], force[active[p + 1]]
        for k in range(elastic.shape[0]):
            elastic[k] += row[k] * f + contact[k] * g
    if n_coupled % 2 == 1:
        row, f = compliance[active[n_coupled - 1]], force[active[n_coupled - 1]]
        for k in range(elastic.shape[0]):
            elastic[k] += row[k] * f


@algebraic_part
def deflect(system: System, gap: Real, work: Workspace) -> None:
    """Elastic deflection of every contact, and the local one that is left [mm]: approach - gap - elastic."""
    jacobian, motion, elastic, depth = system.contact_jacobian, work.motion, work.elastic, work.depth
    for b in range(count(work.active)):
        _bend(system, b, work)
    for i in range(gap.shape[0]):
        depth[i] = -gap[i] - elastic[i]
    for d in range(motion.shape[0]):
        row, q = jacobian[d], motion[d]
        for i in range(gap.shape[0]):
            depth[i] += row[i] * q


@merged_part
def _logarithms(n: int, inner_force: Real, bits: Whole, logarithm: Real, exponent: Real) -> None:
    """Natural logarithms of the first n of ``inner_force`` to the last digits, several at once."""
    for j in range(n):
        logarithm[j] = inner_force[j]
    for j in range(n):
        exponent[j] = (bits[j] >> EXPONENT_BITS) - EXPONENT_BIAS
        bits[j] = (bits[j] & FRACTION) | ONE
    for j in range(n):
        fraction = logarithm[j]
        is_upper = fraction > 1.4142135623730951
        fraction = 0.5 * fraction if is_upper else fraction
        power = exponent[j] + 1.0 if is_upper else exponent[j]
        z = (fraction - 1.0) / (fraction + 1.0)
        square = z * z
        series = 1 / 13 + square * (1 / 15 + square * (1 / 17 + square * (1 / 19 + square * (1 / 21))))
        series = 1 / 5 + square * (1 / 7 + square * (1 / 9 + square * (1 / 11 + square * series)))
        logarithm[j] = power * 0.6931471805599453 + 2.0 * z * (1.0 + square * (1 / 3 + square * series))


@merged_part
def _misfit_of_block(system: System, b: int, work: Workspace) -> tuple[float, float]:
    """Misfits and tangents of the active contacts of a block; returns the largest misfit and deflection."""
    part = part_of(work.active, work, b)
    n, active, force, elastic, depth = work.sizes[b, 0], part.active, work.force, work.elastic, work.depth
    inner_force, logarithm, miss, slope = part.inside, part.logarithm, part.miss, part.slope
    linear, logarithmic, power, limit = system.linear, system.logarithmic, system.power, system.limit
    for j in range(n):
        inner_force[j] = min(force[active[j]], limit[active[j]])
    _logarithms(n, inner_force, part.bits, logarithm, work.column)
    for j in range(n):
        miss[j] = inner_force[j] * (linear[active[j]] - logarithmic[active[j]] * logarithm[j])
    for j in range(n):
        slope[j] = linear[active[j]] - logarithmic[active[j]] * (1.0 + logarithm[j])
    for j in range(n):
        i = active[j]
        if power[i] > 0.0:
            power_part = power[i] * inner_force[j] ** (system.exponent[i] - 1.0)
            miss[j] += inner_force[j] * power_part
            slope[j] += system.exponent[i] * power_part
    largest_deflection, largest_miss = 1e-300, 0.0
    for j in range(n):
        i = active[j]
        local = miss[j] + (force[i] - inner_force[j]) * slope[j]
        miss[j] = local - depth[i]
        largest_deflection = max(largest_deflection, local + elastic[i])
        largest_miss = max(largest_miss, abs(miss[j]))
    return largest_miss, largest_deflection


@algebraic_part
def misfit(system: System, work: Workspace) -> float:
    """Misfit of the deflection of every active contact, and the laws' tangents; returns the relative misfit."""
    deviation, largest_deflection = 0.0, 1e-300
    for b in range(count(work.active)):
        missing, deflection = _misfit_of_block(system, b, work)
        deviation, largest_deflection = max(deviation, missing), max(largest_deflection, deflection)
    return deviation / largest_deflection


@algebraic_part
def largest_force(load: float, work: Workspace) -> float:
    """Largest force of an active contact, or the ``load`` where that is larger [N]."""
    force, largest = work.force, load
    for b in range(count(work.active)):
        active = part_of(work.active, work, b).active
        for j in range(work.sizes[b, 0]):
            largest = max(largest, force[active[j]])
    return largest


@algebraic_part
def imbalance(system: System, friction: Friction | None, torque: float, work: Workspace) -> float:
    """What is unbalanced of every rigid motion; returns the largest share of the sum of its terms, or of ``IDLE``."""
    force, balance, relative = work.force, work.balance, 0.0
    idle = IDLE * largest_force(abs(torque) / system.arm[system.output], work)
    for d in range(balance.shape[0]):
        total = -torque if d == system.output else 0.0
        if system.planar and d < 2 * work.thrust.shape[0]:
            total += work.spring[d // 2, d % 2]
        scale = abs(total)
        row = system.contact_jacobian[d]
        for b in range(count(work.active)):
            if not moves(work.active, system.moving[b], d):
                continue
            active = part_of(work.active, work, b).active
            for j in range(work.sizes[b, 0]):
                term = row[active[j]] * force[active[j]]
                total += term
                scale += abs(term)
        if friction is not None:
            for k in range(work.counts[1]):
                s = friction.resisting[k]
                term = friction.direction[s, d] * friction.resistance[s]
                total += term
                scale += abs(term)
        balance[d] = total
        relative = max(relative, abs(total) / max(scale, idle * system.arm[d], 1e-300))
    return relative


@algebraic_part
def residuals(
    system: System, friction: Friction | None, torque: float, clearance: Real, work: Workspace
) -> tuple[float, float]:
    """Relative misfit of the active contacts and relative imbalance of the motions, and their tangents.

    ``torque`` [N mm] at the output, ``clearance`` (n_disks,) of the bearings [mm].
    """
    if system.planar:
        bearing_springs(system, clearance, work)
    if friction is not None:
        resist(system, friction, work)
    return misfit(system, work), imbalance(system, friction, torque, work)
