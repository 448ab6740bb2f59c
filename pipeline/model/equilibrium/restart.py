"""A load step that Newton does not solve from where it starts: from an interior point, and on by a primal active set.

It is an entry point of its own: the loop over load steps is compiled without it, and faster for that.
"""

from pipeline.model.compiled import borrowing_entry
from pipeline.model.equilibrium.interior_point import INTERIOR_STEPS, start_within
from pipeline.model.equilibrium.primal_active_set import settle


@borrowing_entry
def solved_afresh(system, friction, torque, gap, clearance, work):
    """Solve a load step from no start at all, into ``work``; returns the iterations and the residual."""
    start_within(system, friction, torque, gap, clearance, work)
    n_updates, residual = settle(system, friction, torque, gap, clearance, work)
    return n_updates + INTERIOR_STEPS, residual
