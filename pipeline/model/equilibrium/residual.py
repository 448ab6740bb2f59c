"""The equations of a load step, and what is off in them at given forces and motions (compiled parts).

Active contacts are those that may carry force; those that elastic bodies couple stand first in ``Work.active``.
"""

from typing import NamedTuple

import numpy as np

from pipeline.model.compiled import algebraic_part
from pipeline.model.equilibrium.return_mapping import resist
from pipeline.model.geometry.cycloid_profile import Real

EXPONENT_BITS, EXPONENT_BIAS = 52, 1023
"""Place and bias of the exponent in a double (IEEE 754)."""
FRACTION, ONE = (1 << 52) - 1, 1023 << 52
"""Parts of a binary number of 64 bits, and the bits of 1.0."""


class Friction(NamedTuple):
    """The sliders, see ``contact.friction_elements.Sliders``; None takes its place, and is compiled away, without."""

    direction: Real  # (n_sliders, n_motions)
    stiffness: Real  # (n_sliders,)
    limit: Real
    coefficient: Real
    contact: np.ndarray


class System(NamedTuple):
    """What every sample shares: arms, compliance, force laws and the bearing of one crank angle."""

    contact_jacobian: Real  # (n_motions, n_contacts)
    compliance: Real  # (n_contacts, n_contacts) [mm/N]
    linear: Real  # the laws' numbers (n_contacts,), see contact.ContactLaws
    logarithmic: Real
    power: Real
    exponent: Real
    limit: Real
    output: int  # motion on which the torque acts
    planar: bool  # whether the disk's translation is among the motions
    stiffness: float  # the bearing's, and its exponent
    bearing_exponent: float


class Work(NamedTuple):
    """Room for one sample's solve. Active contacts and the first of them are in the order of ``active``."""

    counts: np.ndarray  # active contacts, coupled ones of them, those in the inverse, solved steps with them, sliders
    active: np.ndarray  # (n_contacts,)
    motion: Real  # (n_motions,) [mm, rad]
    force: Real  # (n_contacts,) [N]
    elastic: Real  # (n_contacts,) deflection of the elastic bodies [mm]
    depth: Real  # (n_contacts,) local deflection that is left [mm]
    miss: Real  # of the active contacts' deflection [mm], then the step of their forces [N]
    slope: Real  # compliance of the active contacts' laws [mm/N]
    balance: Real  # (n_motions,) what is unbalanced
    step: Real  # (n_motions,)
    tangent: Real  # (n_motions, n_motions)
    held: Real  # (n_motions, n_motions) jacobian^T H^-1 jacobian of the contacts in the inverse
    inverse: Real  # of H = law' + C over the first active contacts
    projected: Real  # (n_motions, n_contacts) H^-1 jacobian of them
    column: Real  # (n_contacts,)
    inside: Real  # active forces, held to the laws' range, and their logarithms
    logarithm: Real
    bits: np.ndarray  # the memory of ``logarithm`` as integers
    slack: Real  # of the active contacts, in the interior-point iteration [mm]
    thrust: Real  # (1,) force of the bearing
    spring: Real  # (8,) see bearing_spring
    anchor: Real  # (n_sliders,) slip of every slider without resistance [mm, rad]
    resistance: Real  # (n_sliders,) [N, N mm]; where a slider does not resist, what it did before
    stick: Real  # its slope against the slip
    grip: Real  # its slope against what presses on the slider
    trial: Real  # its resistance if it stuck
    pressed: Real  # what presses on it
    slip_step: Real  # changes of its slip and of what presses on it within the step
    press_step: Real
    resisting: np.ndarray  # sliders that resist
    position: np.ndarray  # (n_contacts,) of the active contacts in ``active``
    row: Real  # (n_motions,)


def workspace(n_motions: int, n_contacts: int, n_sliders: int) -> Work:
    """Arrays for solves of ``n_contacts`` contacts."""
    motions, contacts, sliders = (n_motions,), (n_contacts,), (n_sliders,)
    logarithm = np.zeros(contacts)
    return Work(
        counts=np.zeros(5, np.int64),
        active=np.zeros(contacts, np.int64),
        motion=np.zeros(motions),
        force=np.zeros(contacts),
        elastic=np.zeros(contacts),
        depth=np.zeros(contacts),
        miss=np.zeros(contacts),
        slope=np.zeros(contacts),
        balance=np.zeros(motions),
        step=np.zeros(motions),
        tangent=np.zeros(motions * 2),
        held=np.zeros(motions * 2),
        inverse=np.zeros(contacts * 2),
        projected=np.zeros(motions + contacts),
        column=np.zeros(contacts),
        inside=np.zeros(contacts),
        logarithm=logarithm,
        bits=logarithm.view(np.int64),
        slack=np.zeros(contacts),
        thrust=np.zeros(1),
        spring=np.zeros(8),
        anchor=np.zeros(sliders),
        resistance=np.zeros(sliders),
        stick=np.zeros(sliders),
        grip=np.zeros(sliders),
        trial=np.zeros(sliders),
        pressed=np.zeros(sliders),
        slip_step=np.zeros(sliders),
        press_step=np.zeros(sliders),
        resisting=np.zeros(sliders, np.int64),
        position=np.zeros(contacts, np.int64),
        row=np.zeros(motions),
    )


@algebraic_part
def law(system, i, force):
    """Local deflection and compliance of the closed contact i."""
    inside = min(force, system.limit[i])
    log = np.log(inside)
    deflection = inside * (system.linear[i] - system.logarithmic[i] * log)
    slope = system.linear[i] - system.logarithmic[i] * (1.0 + log)
    if system.power[i] > 0.0:
        powered = system.power[i] * inside ** (system.exponent[i] - 1.0)
        deflection += inside * powered
        slope += system.exponent[i] * powered
    return deflection + (force - inside) * slope, slope


@algebraic_part
def force_at_penetration(system, i, penetration):
    """Force of contact i alone, with law(F) + C_ii F = penetration, to a few per cent: a start for Newton."""
    own = system.compliance[i, i]
    force = penetration / (own + abs(system.linear[i]) + system.logarithmic[i] + system.power[i])
    for _ in range(6):
        deflection, slope = law(system, i, force)
        force = max(0.1 * force, force + (penetration - deflection - own * force) / (slope + own))
    return force


@algebraic_part
def bearing_spring(system, clearance, work):
    """Force and tangent of the bearing into ``spring``: fx, fy, kxx, kxy, kyy, and how the thrust follows the motion.

    The bearing pushes with the unknown ``thrust`` along the displacement u, like a contact:
    |d| - clearance - (thrust/K)^(1/n) = 0 is linearised with it, so that the disk can run around the edge of the
    clearance under a small force.
    """
    thrust, spring = work.thrust, work.spring
    x, y = work.motion[0], work.motion[1]
    for k in range(8):
        spring[k] = 0.0
    if clearance == 0.0 and system.bearing_exponent == 1.0:
        thrust[0] = 0.0  # it follows from the motions, which need not go around
        spring[0], spring[1] = system.stiffness * x, system.stiffness * y
        spring[2], spring[4] = system.stiffness, system.stiffness
        return
    distance = np.sqrt(x * x + y * y)
    if thrust[0] == 0.0 and distance > clearance:
        thrust[0] = system.stiffness * (distance - clearance) ** system.bearing_exponent
    if thrust[0] == 0.0 or distance == 0.0:
        thrust[0] = 0.0
        return
    depth = (thrust[0] / system.stiffness) ** (1.0 / system.bearing_exponent)
    radial, across = system.bearing_exponent * thrust[0] / depth, thrust[0] / distance
    ux, uy = x / distance, y / distance
    miss = distance - clearance - depth
    push = thrust[0] + radial * miss
    spring[0], spring[1] = push * ux, push * uy
    spring[2] = radial * ux * ux + across * uy * uy
    spring[3] = (radial - across) * ux * uy
    spring[4] = radial * uy * uy + across * ux * ux
    spring[5], spring[6], spring[7] = radial * ux, radial * uy, radial * miss


@algebraic_part
def add_deflection(system, i, work):
    """Add the elastic deflection by contact i alone to that of every contact."""
    row, f, elastic, depth = system.compliance[i], work.force[i], work.elastic, work.depth
    for other in range(row.shape[0]):
        elastic[other] += row[other] * f
    for other in range(row.shape[0]):
        depth[other] -= row[other] * f


@algebraic_part
def deflect(system, gap, work):
    """Elastic deflection of every contact, and the local one that is left: approach - gap - elastic."""
    compliance, jacobian, motion = system.compliance, system.contact_jacobian, work.motion
    elastic, depth, active, force = work.elastic, work.depth, work.active, work.force
    for i in range(gap.shape[0]):
        elastic[i] = 0.0
    coupled = work.counts[1]
    for p in range(0, coupled - 1, 2):  # two at once save half of the stores
        row, f = compliance[active[p]], force[active[p]]
        other, g = compliance[active[p + 1]], force[active[p + 1]]
        for i in range(gap.shape[0]):
            elastic[i] += row[i] * f + other[i] * g
    if coupled % 2 == 1:
        row, f = compliance[active[coupled - 1]], force[active[coupled - 1]]
        for i in range(gap.shape[0]):
            elastic[i] += row[i] * f
    for i in range(gap.shape[0]):
        depth[i] = -gap[i] - elastic[i]
    for d in range(motion.shape[0]):
        row, q = jacobian[d], motion[d]
        for i in range(gap.shape[0]):
            depth[i] += row[i] * q


@algebraic_part
def _logarithms(n, work):
    """Natural logarithms of the first n of ``inside`` to the last digits, several at once."""
    inside, bits, logarithm, exponent = work.inside, work.bits, work.logarithm, work.column
    for j in range(n):
        logarithm[j] = inside[j]
    for j in range(n):
        exponent[j] = (bits[j] >> EXPONENT_BITS) - EXPONENT_BIAS
        bits[j] = (bits[j] & FRACTION) | ONE
    for j in range(n):
        fraction = logarithm[j]
        above = fraction > 1.4142135623730951
        fraction = 0.5 * fraction if above else fraction
        power = exponent[j] + 1.0 if above else exponent[j]
        z = (fraction - 1.0) / (fraction + 1.0)
        square = z * z
        series = 1 / 13 + square * (1 / 15 + square * (1 / 17 + square * (1 / 19 + square * (1 / 21))))
        series = 1 / 5 + square * (1 / 7 + square * (1 / 9 + square * (1 / 11 + square * series)))
        logarithm[j] = power * 0.6931471805599453 + 2.0 * z * (1.0 + square * (1 / 3 + square * series))


@algebraic_part
def misfit(system, work):
    """Misfit of the deflection of every active contact, and the laws' tangents; returns the relative misfit."""
    n, active, force, elastic, depth = work.counts[0], work.active, work.force, work.elastic, work.depth
    inside, logarithm, miss, slope = work.inside, work.logarithm, work.miss, work.slope
    linear, logarithmic, power, limit = system.linear, system.logarithmic, system.power, system.limit
    for j in range(n):
        inside[j] = min(force[active[j]], limit[active[j]])
    _logarithms(n, work)
    for j in range(n):
        miss[j] = inside[j] * (linear[active[j]] - logarithmic[active[j]] * logarithm[j])
    for j in range(n):
        slope[j] = linear[active[j]] - logarithmic[active[j]] * (1.0 + logarithm[j])
    for j in range(n):
        i = active[j]
        if power[i] > 0.0:
            powered = power[i] * inside[j] ** (system.exponent[i] - 1.0)
            miss[j] += inside[j] * powered
            slope[j] += system.exponent[i] * powered
    largest, off = 1e-300, 0.0
    for j in range(n):
        i = active[j]
        local = miss[j] + (force[i] - inside[j]) * slope[j]
        miss[j] = local - depth[i]
        largest = max(largest, local + elastic[i])
        off = max(off, abs(miss[j]))
    return off / largest


@algebraic_part
def imbalance(system, friction, torque, work):
    """What is unbalanced of every rigid motion; returns the largest share of the sum of its terms."""
    n, active, force, balance = work.counts[0], work.active, work.force, work.balance
    jacobian, relative = system.contact_jacobian, 0.0
    for d in range(balance.shape[0]):
        total = -torque if d == system.output else 0.0
        if system.planar and d < 2:
            total += work.spring[d]
        scale = abs(total)
        row = jacobian[d]
        for j in range(n):
            term = row[active[j]] * force[active[j]]
            total += term
            scale += abs(term)
        if friction is not None:
            for k in range(work.counts[4]):
                s = work.resisting[k]
                term = friction.direction[s, d] * work.resistance[s]
                total += term
                scale += abs(term)
        balance[d] = total
        relative = max(relative, abs(total) / max(scale, 1e-300))
    return relative


@algebraic_part
def residuals(system, friction, torque, clearance, work):
    """Relative misfit of the active contacts and relative imbalance of the motions, and their tangents."""
    if system.planar:
        bearing_spring(system, clearance, work)
    if friction is not None:
        resist(system, friction, work)
    return misfit(system, work), imbalance(system, friction, torque, work)
