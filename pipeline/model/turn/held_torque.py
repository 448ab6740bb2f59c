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
    """Force of the disks on each bearing (n, 2, n_bearings) complex [N], housing frame, at plus and minus the torque.

    The order is that of ``Reducer.bearings``.

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
    """Force of the disks on each bearing (n, n_states, n_bearings) complex [N] under forces (..., n_contacts) [N].

    Notes
    -----
    The disk is in balance between its contacts and its bearing, so the bearing bears the contacts' resultant on the
    disk: the penetrations ``contact_jacobian q`` grow against it. Of a disk that the output mechanism carries, the
    contacts in each hole are a bearing, which bears what they push its eccentric. A body between disk and output that
    only rotates is held from aside by nothing real: what its contacts push the disk aside counts for the bearing, which
    then bears the pins alone, as it does where that body floats.
    """
    if reducer.is_centred:
        push = -reducer.contact_jacobian[:, reducer.disk_motions]
        push[_with_held_between(reducer)] = 0.0
    else:
        contacts, keys = reducer.contacts, np.stack([reducer.disk_of_contact, reducer.contacts.hole], axis=1)
        normals = np.stack([contacts.normal.real, contacts.normal.imag], axis=1)
        push = np.all(keys[:, None] == reducer.bearings, axis=2)[..., None] * normals[:, None]
    # one product a sample: the digits do not depend on how many there are
    resultant = (force @ push.reshape(len(push), -1)).reshape(*force.shape[:2], *push.shape[1:])
    return resultant[..., 0] + 1j * resultant[..., 1]


def _with_held_between(reducer: Reducer) -> NDArray[np.bool_]:
    """Contacts (n_contacts,) with a body between disk and output that only rotates in the model."""
    movable = {motion.rsplit("_", 1)[0] for motion in reducer.motions if motion.endswith(("_x", "_y"))}
    fixed_ends = np.array([*movable, HOUSING, "output"])
    return ~(np.isin(reducer.contacts.body_a, fixed_ends) & np.isin(reducer.contacts.body_b, fixed_ends))


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


def crank_torque(eccentricity: float, crank: Real, n_disks: int, thrust: NDArray[np.complex128]) -> Real:
    """Torque on the cranks (n, 2, n_angles) [N mm] that balances the disks on their eccentrics, equally spaced.

    Parameters
    ----------
    eccentricity : [mm]
    crank : (n_angles,) [rad]
    thrust : (n, 2, n_angles, n_bearings) [N], of the disks on their bearings, disk after disk.

    Notes
    -----
    Without friction it is the torque on the output over the ratio, at every crank angle and whatever the errors: all
    normals of the pins pass through the pitch point, about which the disk turns.
    """
    phase = np.repeat(2 * np.pi * np.arange(n_disks) / n_disks, thrust.shape[3] // n_disks)
    eccentric = np.exp(1j * np.add.outer(crank, phase))
    return -eccentricity * np.sum(np.imag(np.conj(eccentric) * thrust), axis=3)
