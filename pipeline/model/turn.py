"""A turn of the crank: forces under a torque that is held, what single contacts bear, sliding, orders of an error."""

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Complex, Real, Truth
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.geometry.contacts import HOUSING, PIN
from pipeline.model.geometry.cycloid_profile import CycloidProfile
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.loop_readings import held_states
from pipeline.model.load_history.response import CycleResponse
from pipeline.model.metrics import Definitions


@dataclass(frozen=True)
class Orders:
    """Harmonics of ``n`` errors, sum over the orders of amplitude cos(order crank + phase).

    Attributes
    ----------
    order : (n_orders,) waves per turn of the crank, ascending, without the mean.
    amplitude : (n, n_orders) in the unit of the error.
    phase : (n, n_orders) [rad]
    """

    order: Real
    amplitude: Real
    phase: Real


def orders(error: Real, turns: int = 1) -> Orders:
    """Orders of errors (n, n_angles) at angles evenly over so many turns of the crank, from crank angle 0.

    Notes
    -----
    As many as the angles tell apart: below half of the angles a turn. Waves above fold back onto them.

    Source
    ------
    Discrete Fourier transform; Oppenheim and Schafer, Discrete-Time Signal Processing (2010), ch. 8.
    """
    n_angles = error.shape[-1]
    told_apart = (n_angles - 1) // 2
    spectrum = np.fft.rfft(error, axis=-1)[..., 1 : told_apart + 1] * (2 / n_angles)
    return Orders(np.arange(1, told_apart + 1) / turns, np.abs(spectrum), np.angle(spectrum))


def held_forces(response: CycleResponse, definitions: Definitions) -> Real:
    """Contact forces (n, 2, n_contacts) [N] at plus and minus the torque held; see ``bearing_force``."""
    return response.equilibria.force[:, held_states(response, definitions)]


def bearing_force(drive: Drive, response: CycleResponse, definitions: Definitions) -> Complex:
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


def on_bearings(reducer: Reducer, force: Real) -> Complex:
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


def _with_held_between(reducer: Reducer) -> Truth:
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
    shares: Real = of_disks / of_disks.sum(axis=2, keepdims=True)
    return shares


def crank_torque(eccentricity: float, crank: Real, n_disks: int, thrust: Complex) -> Real:
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
    torque: Real = -eccentricity * np.sum(np.imag(np.conj(eccentric) * thrust), axis=3)
    return torque


def sliding_speed(profile: CycloidProfile, reducer: Reducer, crank_speed: float) -> Real:
    """Speed (n_contacts,) [mm/s] at which the surfaces of the contacts pass each other; 0 of rollers and of teeth.

    Parameters
    ----------
    crank_speed : of the crank, housing held [rad/s].

    Notes
    -----
    The disk turns about the pitch point, at the crank's speed over the ratio: at a pin it slides by that times the
    distance of the contact from the pitch point, R S - r. Disk and output turn alike, so a hole passes its output pin
    as the disk's centre moves for the output, e N/(N - 1) times the crank's speed, along the wall. Where a cylinder
    rolls on the disk instead, it slides at the same speed in its seat.

    Source
    ------
    Instantaneous centres: Litvin and Fuentes, Gear Geometry and Applied Theory (2004), ch. 3 and 13.
    """
    contacts = reducer.contacts
    bodies = [disk.body for disk in reducer.disks]
    of_disk = np.array([bodies.index(body) if body in bodies else 0 for body in contacts.body_b])
    pitch_point = profile.pins * np.array([disk.eccentric for disk in reducer.disks])[of_disk]
    at_pins = np.abs(contacts.point - pitch_point) / profile.lobes
    slides = (contacts.hole >= 0) & reducer.is_centred  # else they are rollers of the bearings that carry the disk
    in_holes = np.where(slides, profile.eccentricity * profile.pins / profile.lobes, 0.0)
    return abs(crank_speed) * np.where(contacts.kind == PIN, at_pins, in_holes)


LARGEST_SHEAR = 0.300
"""Largest shear stress below a line contact over its peak pressure."""
SHEAR_DEPTH = 0.786
"""Its depth over the half width of the contact."""


@dataclass(frozen=True)
class Running:
    """How the contacts of a reducer run at one crank angle, arrays (n_contacts,).

    Attributes
    ----------
    length : of the contact [mm].
    seat : projected area of the seat of a cylinder that rolls on the disk [mm^2]; 0 where it slides on the disk.
    speed : of the sliding there [mm/s]; missing where the design states no speed.
    friction : coefficient [-], missing where the design names none.
    """

    length: Real
    seat: Real
    speed: Real
    friction: Real

    def sliding_pressure(self, laws: ContactLaws, force: Real) -> Real:
        """Pressure (..., n_contacts) [MPa] where it slides: Hertz' peak on the disk, the mean one in a seat."""
        in_seat = np.divide(force, self.seat, out=np.zeros(np.shape(force)), where=self.seat > 0)
        return np.where(self.seat > 0, in_seat, laws.peak_pressure(force))

    def pressure_speed(self, laws: ContactLaws, force: Real) -> Real:
        """Pressure times sliding speed PV (..., n_contacts) [MPa m/s] at ``force`` (..., n_contacts) [N]."""
        return 1e-3 * self.speed * self.sliding_pressure(laws, force)

    def friction_power(self, force: Real) -> Real:
        """Power (...) [W] that sliding takes at ``force`` (..., n_contacts) [N]."""
        return 1e-3 * force @ (self.friction * self.speed)

    def shear_depth(self, laws: ContactLaws, force: Real) -> Real:
        """Depth (..., n_contacts) [mm] of the largest shear stress, that of a smooth line contact without friction.

        Source
        ------
        Johnson, Contact Mechanics (1985), 4.2: tau = 0.300 p0 at 0.786 b, and p0 = 2 F/(pi b L).
        """
        pressure = laws.peak_pressure(force)
        width = np.divide(2 * force, np.pi * self.length * pressure, out=np.zeros(np.shape(force)), where=pressure > 0)
        return SHEAR_DEPTH * width
