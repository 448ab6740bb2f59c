"""Forces of a drive at one crank angle while a torque is held on its output, in either sense."""

import numpy as np
from numpy.typing import NDArray

from pipeline.model.geometry.contacts import HOUSING
from pipeline.model.geometry.cycloid_profile import Real
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.loop_readings import held_states
from pipeline.model.load_history.response import CycleResponse
from pipeline.model.metrics import Definitions


def held_forces(response: CycleResponse, definitions: Definitions) -> Real:
    """Contact forces (n, 2, n_contacts) [N] at plus and minus the torque held; see ``bearing_force``."""
    return response.equilibria.force[:, held_states(response, definitions)]


def bearing_force(drive: Drive, response: CycleResponse, definitions: Definitions) -> NDArray[np.complex128]:
    """Force of each disk on its input bearing (n, 2, n_disks) complex [N], housing frame, at plus and minus the torque.

    Parameters
    ----------
    response : of the drive to a load cycle with the torques of the definitions.
    definitions : their higher torque of the rigidity is the one that is held.

    Raises
    ------
    ValueError
        If the cycle lacks the torque.
    """
    return on_bearings(drive.reducer, held_forces(response, definitions))


def on_bearings(reducer: Reducer, force: Real) -> NDArray[np.complex128]:
    """Force of each disk on its input bearing (n, n_states, n_disks) complex [N] under forces (..., n_contacts) [N].

    Notes
    -----
    The disk is in balance between its contacts and its bearing, so the bearing bears the contacts' resultant on the
    disk: the penetrations ``contact_jacobian q`` grow against it. A disk that the output mechanism carries has none.
    A body between disk and output that only rotates is held from aside by nothing real: what its contacts push the disk
    aside counts for the bearing, which then bears the pins alone, as it does where that body floats.
    """
    jacobian = reducer.contact_jacobian[:, reducer.disk_motions].copy()
    jacobian[_with_held_between(reducer)] = 0.0
    # one product a sample: the digits do not depend on how many there are
    resultant = -(force @ jacobian.reshape(len(jacobian), -1)).reshape(*force.shape[:2], *jacobian.shape[1:])
    if not reducer.centred:
        resultant[:] = np.nan
    return resultant[..., 0] + 1j * resultant[..., 1]


def _with_held_between(reducer: Reducer) -> NDArray[np.bool_]:
    """Contacts (n_contacts,) with a body between disk and output that only rotates in the model."""
    movable = {motion.rsplit("_", 1)[0] for motion in reducer.motions if motion.endswith(("_x", "_y"))}
    fixed = np.array([*movable, HOUSING, "output"])
    return ~(np.isin(reducer.contacts.body_a, fixed) & np.isin(reducer.contacts.body_b, fixed))


def torque_shares(drive: Drive, response: CycleResponse, definitions: Definitions) -> Real:
    """Share of each disk in the torque on the output (n, 2, n_disks) [-], at plus and minus the torque held.

    It is the moment of the disk's contacts with the output over that of all; raises as ``bearing_force``.
    """
    reducer = drive.reducer
    if reducer.n_disks == 1:
        return np.ones((len(drive.gap), 2, 1))
    moment = held_forces(response, definitions) * reducer.contact_jacobian[:, reducer.output_motion]
    of_disks = np.stack(
        [moment[..., reducer.disk_of_contact == disk].sum(axis=2) for disk in range(reducer.n_disks)], axis=2
    )
    return of_disks / of_disks.sum(axis=2, keepdims=True)


def input_torque(eccentricity: float, crank: Real, thrust: NDArray[np.complex128]) -> Real:
    """Torque on the input (n, 2, n_angles) [N mm] that balances the disks on their eccentrics, equally spaced.

    Parameters
    ----------
    eccentricity : [mm]
    crank : (n_angles,) [rad]
    thrust : (n, 2, n_angles, n_disks) [N], of the disks on their input bearings.

    Notes
    -----
    Without friction it is the torque on the output over the ratio, at every crank angle and whatever the errors: all
    normals of the pins pass through the pitch point, about which the disk turns.
    """
    n_disks = thrust.shape[3]
    eccentric = np.exp(1j * np.add.outer(crank, 2 * np.pi * np.arange(n_disks) / n_disks))
    return -eccentricity * np.sum(np.imag(np.conj(eccentric) * thrust), axis=3)
