"""Poses to start a load step from where no bearing holds the disks: rigid bodies' forces, and what they deflect."""

import numpy as np
import scipy  # its functions are slow to import: they are when they are called

from pipeline.arrays import Real
from pipeline.model.equilibrium.solve import ElasticReducer

TOUCHING = 1e-7
"""Gap [mm] that is left of a contact which limits the play: the accuracy of the linear program."""


def loaded_poses(elastic: ElasticReducer, gap: Real, pose: Real, torque: float) -> Real:
    """Poses (n, n_motions) near equilibrium under a small ``torque`` [N mm], from ends of play (n, n_motions).

    Notes
    -----
    At an end of play the contacts that stop it balance the torque by forces >= 0 (the duals of its program); each of
    them is then as deep as it deflects under its force.
    """
    reducer = elastic.reducer
    jacobian, start = reducer.contact_jacobian, pose.copy()
    rotates = [motion.endswith(("_phi", "_psi")) for motion in reducer.motions]
    scale = np.where(rotates, 1 / np.abs(jacobian).max(), 1.0)
    load = np.zeros(len(scale))
    load[reducer.output_motion] = torque
    force = np.zeros_like(gap)
    for k, slack in enumerate(gap - pose @ jacobian.T):
        stopping = np.flatnonzero(slack < TOUCHING)
        if len(stopping):
            force[k, stopping], _ = scipy.optimize.nnls((jacobian[stopping] * scale).T, load * scale)
    depth = elastic.laws.deflection(force) + force @ elastic.compliance
    for k, carries in enumerate(force > 0):
        start[k] += np.linalg.lstsq(jacobian[carries], depth[k, carries], rcond=None)[0]
    return start
