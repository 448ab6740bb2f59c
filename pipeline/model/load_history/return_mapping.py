"""Resistances of sliders in the equilibrium, and their anchors: return mapping as in plasticity.

Source: Simo, Hughes, Computational Inelasticity (1998), ch. 1.
"""

from pipeline.model.compiled import part


@part
def _pressing(contact, output_jacobian, force):
    """What presses on a slider: the force of its contact, or the torque that all of them carry to the output."""
    if contact >= 0:
        return force[contact]
    carried = 0.0
    for i in range(force.shape[0]):
        carried += output_jacobian[i] * force[i]
    return carried


@part
def slide(sliders, output_jacobian, anchor, q, force, balance, scale, right_block, columns, tangent):
    """Add the sliders' resistances to the balance and their tangents to the blocks of Newton's matrix.

    ``columns`` gives the place of a contact's force among the unknowns, -1 for an open one.
    """
    direction, stiffness, limit, coefficient, contact = sliders
    n_motions = q.shape[0]
    for s in range(stiffness.shape[0]):
        slip = -anchor[s]
        for d in range(n_motions):
            slip += direction[s, d] * q[d]
        i = contact[s]
        pressed = _pressing(i, output_jacobian, force) if coefficient[s] > 0.0 else 0.0
        largest = limit[s] + coefficient[s] * abs(pressed)
        resisted = stiffness[s] * slip
        if abs(resisted) > largest:
            sense = 1.0 if resisted > 0.0 else -1.0
            resisted = sense * largest
            if i >= 0 and columns[i] >= 0:
                for d in range(n_motions):
                    right_block[d, columns[i]] += sense * coefficient[s] * direction[s, d]
            elif i < 0 and coefficient[s] > 0.0:
                grown = sense * coefficient[s] * (1.0 if pressed > 0.0 else -1.0)
                for other in range(force.shape[0]):
                    if columns[other] >= 0:
                        for d in range(n_motions):
                            right_block[d, columns[other]] += grown * output_jacobian[other] * direction[s, d]
        else:
            for d in range(n_motions):
                for e in range(n_motions):
                    tangent[d, e] += stiffness[s] * direction[s, d] * direction[s, e]
        for d in range(n_motions):
            term = direction[s, d] * resisted
            balance[d] += term
            scale[d] += abs(term)


@part
def anchor_on(sliders, output_jacobian, anchor, q, force):
    """Let the anchors follow where the resistance is at its limit."""
    direction, stiffness, limit, coefficient, contact = sliders
    for s in range(stiffness.shape[0]):
        slip = 0.0
        for d in range(q.shape[0]):
            slip += direction[s, d] * q[d]
        pressed = _pressing(contact[s], output_jacobian, force) if coefficient[s] > 0.0 else 0.0
        reach = (limit[s] + coefficient[s] * abs(pressed)) / stiffness[s]
        anchor[s] = min(max(anchor[s], slip - reach), slip + reach)
