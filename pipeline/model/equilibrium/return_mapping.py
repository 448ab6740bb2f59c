"""Resistances of sliders in a load step, their tangent and their anchors: return mapping as in plasticity.

A slider that would be pulled beyond its limit is held at it, and once the load step is solved its anchor follows. The
limit may grow with what presses on the slider, so that Newton's tangent is not symmetric where it slips.

Source: Simo, Hughes, Computational Inelasticity (1998), ch. 1.
"""

from pipeline.model.compiled import algebraic_part
from pipeline.model.equilibrium.blocks import Friction, System, Workspace, count, part_of

BRAKING_SHARE = 0.1
"""A step ends where the power along it has fallen to this share of the one at its start."""
BRAKING_STEPS = 12
"""Evaluations of the power along a step."""


@algebraic_part
def _output_torque(system: System, work: Workspace) -> float:
    """Torque that the contacts carry to the output."""
    arm, total = system.contact_jacobian[system.output], 0.0
    for b in range(count(work.active)):
        active = part_of(work.active, work, b).active
        for j in range(work.sizes[b, 0]):
            total += arm[active[j]] * work.force[active[j]]
    return total


@algebraic_part
def resist(system: System, friction: Friction, work: Workspace) -> None:
    """Resistance of every slider, its slope against the slip (0 where it slips) and against what presses on it.

    ``resisting`` lists those that resist at all.
    """
    motion = work.motion
    carried_torque, resisting = _output_torque(system, work), 0
    for s in range(friction.stiffness.shape[0]):
        pressing_force = carried_torque if friction.contact[s] < 0 else work.force[friction.contact[s]]
        limit = friction.limit[s] + friction.coefficient[s] * abs(pressing_force)
        if limit == 0.0:
            continue
        slip = -friction.anchor[s]
        for d in range(motion.shape[0]):
            slip += friction.direction[s, d] * motion[d]
        trial = friction.stiffness[s] * slip
        friction.trial[s], friction.pressing_force[s] = trial, pressing_force
        friction.resistance[s] = min(max(trial, -limit), limit)
        slips = abs(trial) > limit
        friction.stick[s] = 0.0 if slips else friction.stiffness[s]
        direction_sign = 1.0 if (trial > 0.0) == (pressing_force >= 0.0) else -1.0
        friction.grip[s] = direction_sign * friction.coefficient[s] if slips else 0.0
        friction.resisting[resisting] = s
        resisting += 1
    work.counts[1] = resisting


@algebraic_part
def add_friction(system: System, friction: Friction, work: Workspace) -> None:
    """Add the sliders' tangent to that of the contacts, a lower triangle before and a full matrix after.

    ``step`` holds jacobian^T H^-1 miss - balance, ``inside`` H^-1 miss of the coupled contacts: where the resistance
    follows a contact's force or the torque carried, they belong to the balance as much as the contact's own push.
    """
    jacobian, tangent, step = system.contact_jacobian, work.tangent, work.step
    position, output = friction.position, system.output
    n_motions = step.shape[0]
    for d in range(n_motions):
        for e in range(d):
            tangent[e, d] = tangent[d, e]
    for b in range(count(work.active)):
        active = part_of(work.active, work, b).active
        for j in range(work.sizes[b, 0]):
            position[active[j]] = j
    carried_torque, row = step[output] + work.balance[output], friction.row
    for e in range(n_motions):
        row[e] = tangent[output, e]
    for k in range(work.counts[1]):
        s = friction.resisting[k]
        direction, stick, grip, i = friction.direction[s], friction.stick[s], friction.grip[s], friction.contact[s]
        p, b = (position[i], system.block[i]) if i >= 0 else (0, 0)
        part = part_of(work.active, work, b)
        for d in range(n_motions):
            slip_direction = direction[d]
            if slip_direction == 0.0:
                continue
            for e in range(n_motions):
                tangent[d, e] += slip_direction * stick * direction[e]
            if grip == 0.0:
                continue
            if i < 0:
                step[d] += slip_direction * grip * carried_torque
                for e in range(n_motions):
                    tangent[d, e] += slip_direction * grip * row[e]
            elif system.self_compliance[i] > 0.0:
                step[d] += slip_direction * grip * part.inside[p]
                for e in range(n_motions):
                    tangent[d, e] += slip_direction * grip * part.projection[e, p]
            else:
                step[d] += slip_direction * grip * part.miss[p] / part.slope[p]
                for e in range(n_motions):
                    tangent[d, e] += slip_direction * grip * jacobian[e, i] / part.slope[p]


@algebraic_part
def _work_rate(friction: Friction, length: float, work: Workspace) -> float:
    """Power of the sliders along a share of the step, less that at its start."""
    rate = 0.0
    for k in range(work.counts[1]):
        s = friction.resisting[k]
        limit = friction.limit[s] + friction.coefficient[s] * abs(
            friction.pressing_force[s] + length * friction.press_step[s]
        )
        trial = friction.trial[s] + length * friction.stiffness[s] * friction.slip_step[s]
        rate += friction.slip_step[s] * (min(max(trial, -limit), limit) - friction.resistance[s])
    return rate


@algebraic_part
def share_of_braking(system: System, friction: Friction, work: Workspace) -> float:
    """Share of the step at which the sliders have stopped it: beyond, they would push it back.

    Along the step everything but the sliders is taken for linear. Sticking sliders that slip at its end, or slip back,
    make it overshoot; it ends where the power of all forces along it vanishes.
    """
    if work.counts[1] == 0:
        return 1.0
    jacobian, step, spring = system.contact_jacobian, work.step, work.spring
    start, slope, carried_torque = 0.0, 0.0, 0.0
    for b in range(count(work.active)):
        part = part_of(work.active, work, b)
        for j in range(work.sizes[b, 0]):
            carried_torque += jacobian[system.output, part.active[j]] * part.miss[j]
    for d in range(step.shape[0]):
        start += work.balance[d] * step[d]
        for b in range(count(work.active)):
            part = part_of(work.active, work, b)
            for j in range(work.sizes[b, 0]):
                slope += step[d] * jacobian[d, part.active[j]] * part.miss[j]
    if system.planar:
        for k in range(spring.shape[0]):
            x, y = step[2 * k], step[2 * k + 1]
            slope += x * (spring[k, 2] * x + 2.0 * spring[k, 3] * y) + y * spring[k, 4] * y
    for k in range(work.counts[1]):
        s, i = friction.resisting[k], friction.contact[friction.resisting[k]]
        part = part_of(work.active, work, system.block[max(i, 0)])
        friction.press_step[s] = carried_torque if i < 0 else part.miss[friction.position[i]]
        friction.slip_step[s] = 0.0
        for d in range(step.shape[0]):
            friction.slip_step[s] += friction.direction[s, d] * step[d]
    low, low_power, high = 0.0, start, 1.0
    high_power = start + slope + _work_rate(friction, 1.0, work)
    if not (low_power < 0.0 and high_power > -BRAKING_SHARE * low_power):
        return 1.0
    for _ in range(BRAKING_STEPS):
        share = low - low_power * (high - low) / (high_power - low_power)
        power = start + share * slope + _work_rate(friction, share, work)
        if abs(power) <= -BRAKING_SHARE * start:
            return share
        if power < 0.0:
            low, low_power, high_power = share, power, 0.5 * high_power
        else:
            high, high_power, low_power = share, power, 0.5 * low_power
    return low if low > 0.0 else high


@algebraic_part
def follow(system: System, friction: Friction, work: Workspace) -> None:
    """Let the anchors follow where the resistance is at its limit."""
    motion, anchor = work.motion, friction.anchor
    carried_torque = _output_torque(system, work)
    for s in range(friction.stiffness.shape[0]):
        slip = 0.0
        for d in range(motion.shape[0]):
            slip += friction.direction[s, d] * motion[d]
        pressing_force = carried_torque if friction.contact[s] < 0 else work.force[friction.contact[s]]
        reach = (friction.limit[s] + friction.coefficient[s] * abs(pressing_force)) / friction.stiffness[s]
        anchor[s] = min(max(anchor[s], slip - reach), slip + reach)
