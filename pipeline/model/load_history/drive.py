"""A reducer as it is mounted: errors, springs, friction and what lies between its output and the torque.

A drive is one crank angle of one reducer, its gaps in ``n`` states (the samples of a study, or the cycles of a
measured unit). Effects (``pipeline.model.effects``) are functions from drive to drive.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pipeline.model.contact.friction_elements import Sliders
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.equilibrium.loaded_start import loaded_poses
from pipeline.model.equilibrium.solve import ElasticReducer, Equilibria, solve
from pipeline.model.geometry.clearance import Errors, gaps
from pipeline.model.geometry.cycloid_profile import CycloidProfile, Real
from pipeline.model.geometry.reducer import Bearing, Reducer, of_each_disk
from pipeline.model.geometry.rigid_backlash import rigid_play, separated_play

NO_LOAD = 1e-5
"""Share of the rated torque that stands for the limit of no torque on either side of the play: its twist is below 1e-4
arcmin; at smaller ones the force on a bearing with clearance drowns in the rounding of the clearance."""


@dataclass(frozen=True)
class GapReading:
    """How errors become gaps; the arguments of ``clearance.gaps``."""

    method: str
    disk_reading: str
    roller_reading: str


@dataclass(frozen=True)
class Creep:
    """Kelvin-Voigt element in series with the output: delayed compliance [rad/(N mm)] and its time constant [s]."""

    compliance: float
    time_constant: float


@dataclass(frozen=True)
class HardeningSpring:
    """Cubic spring in series with the output, soft at first: torque / knee = x + x^3, twist = compliance knee x.

    Source: stiffness of strain-wave gears, Tuttle and Seering, IEEE Trans. Robot. Autom. 12 (1996) 368.

    Attributes
    ----------
    compliance : without load [rad/(N mm)].
    knee : torque [N mm]; at twice of it the cubic part carries as much as the linear one.
    """

    compliance: float
    knee: float

    def twist(self, torque: Real) -> Real:
        """Rotation [rad] under a torque [N mm]: the real root of the cubic, by hyperbolic functions."""
        scaled = np.asarray(torque, float) / self.knee
        root = 2 / np.sqrt(3) * np.sinh(np.arcsinh(1.5 * np.sqrt(3) * scaled) / 3)
        return self.compliance * self.knee * root


@dataclass(frozen=True)
class Drive:
    """One crank angle of a reducer in ``n`` states.

    Attributes
    ----------
    rated_torque : [N mm]
    errors : manufacturing errors (n, ...) [mm].
    shift : gap that the errors do not describe (n, n_contacts) [mm]: wear, growth, preload.
    bearing_clearance : (n,) of all bearings alike, or (n, n_disks) [mm].
    compliance : of the elastic bodies between the contacts (n_contacts, n_contacts) [mm/N].
    sliders : friction.
    lean : torque beyond the one carried, over it, that the turning end takes in either sense of motion: half of what
        friction in proportion to the load resists more with the load than against it.
    torsion : compliance between the reducer's output and the torque [rad/(N mm)].
    hardening : further spring there, which stiffens with its torque, or None.
    creep : delayed part of the torsion, or None.
    rayleigh : coefficient of a twist in series with hysteresis [rad/(N mm)^2]; see ``rayleigh.rayleigh_twist``.
    modulus : (n,) factor of the modulus of all elastic parts in each state, or None for 1.
    known : gap of the errors alone (n, n_contacts) [mm], where it was found before.
    """

    profile: CycloidProfile
    reducer: Reducer
    bearing: Bearing
    laws: ContactLaws
    compliance: Real
    rated_torque: float
    errors: Errors
    reading: GapReading
    shift: Real
    bearing_clearance: Real
    sliders: Sliders = field(default_factory=Sliders.none)
    lean: float = 0.0
    torsion: float = 0.0
    hardening: HardeningSpring | None = None
    creep: Creep | None = None
    rayleigh: float = 0.0
    modulus: Real | None = None
    known: Real | None = None

    @cached_property
    def gap_of_errors(self) -> Real:
        """Gap that the errors alone leave (n, n_contacts) [mm]."""
        if self.known is not None:
            return self.known
        return gaps(self.profile, self.reducer, self.errors, **vars(self.reading))

    @cached_property
    def gap(self) -> Real:
        """Gap of every contact at the nominal pose (n, n_contacts) [mm]."""
        return self.gap_of_errors + self.shift

    @cached_property
    def first(self) -> "Drive":
        """The drive in its first state alone."""
        return self.some(slice(1))

    def some(self, states: np.ndarray | slice) -> "Drive":
        """The drive in some of its states."""
        return replace(
            self,
            errors=Errors(**{name: values[states] for name, values in vars(self.errors).items()}),
            shift=self.shift[states],
            bearing_clearance=self.bearing_clearance[states],
            modulus=None if self.modulus is None else self.modulus[states],
            known=self.gap_of_errors[states],
        )

    @cached_property
    def laws_of_states(self) -> ContactLaws:
        """Laws of the contacts with each state's modulus, (n, 1, n_contacts) each; where that is 1, the laws.

        At a force that is larger by the factor of the modulus a contact deflects as much. Where a stiffness is stated,
        a law that is linear, it is left as it is.
        """
        if self.modulus is None:
            return self.laws
        factor, laws = self.modulus[:, None, None], self.laws
        stated = (laws.logarithmic == 0) & (laws.power == 0)
        return ContactLaws(
            linear=np.where(stated, laws.linear, (laws.linear + laws.logarithmic * np.log(factor)) / factor),
            logarithmic=laws.logarithmic / factor,
            power=laws.power / factor**laws.exponent,
            exponent=laws.exponent + np.zeros_like(factor),
            force_limit=laws.force_limit * factor,
            pressure=laws.pressure * np.sqrt(factor),
        )

    def elastic_deflection(self, force: Real) -> Real:
        """What the elastic bodies give way at each contact (n, n_torques, n_contacts) [mm] under forces [N] there."""
        elastic = force @ self.compliance
        return elastic if self.modulus is None else elastic / self.modulus[:, None, None]

    def stiffening(self, state: int) -> float:
        """Torque over that which turns the reducer as far with the modulus of the drawing, in a state.

        Forces on elastic parts that follow Hooke and Hertz enter as force over modulus alone.
        """
        return 1.0 if self.modulus is None else float(self.modulus[state])

    def twist(self, torque: Real) -> Real:
        """Rotation [rad] between the reducer's output and a torque [N mm], at once."""
        linear = self.torsion * torque
        return linear if self.hardening is None else linear + self.hardening.twist(torque)

    @property
    def clearance_of_disks(self) -> Real:
        """Clearance of each disk's bearing (n, n_disks) [mm]."""
        return of_each_disk(self.bearing_clearance, self.reducer.n_disks)

    @property
    def without_twist(self) -> "Drive":
        """The reducer alone, up to its output."""
        return replace(self, torsion=0.0, hardening=None, known=self.gap_of_errors)

    def shifted(self, added_gap: Real) -> "Drive":
        """The drive with every gap larger by ``more`` (n, n_contacts) [mm]."""
        return replace(self, shift=self.shift + added_gap, known=self.gap_of_errors)

    def moved(self, **errors: Real) -> "Drive":
        """The drive with errors [mm] added to its own, by their names; broadcast to the errors' shapes."""
        return self.with_errors(
            replace(self.errors, **{name: getattr(self.errors, name) + added for name, added in errors.items()})
        )

    def with_errors(self, errors: Errors) -> "Drive":
        """The drive with other errors."""
        return replace(self, errors=errors, known=None)

    @property
    def elastic(self) -> ElasticReducer:
        """The reducer on its springs, their modulus the drawing's."""
        return ElasticReducer(self.reducer, self.bearing, self.laws, self.compliance)

    def equilibria(self, start: Real, torque: Real) -> Equilibria:
        """Frictionless equilibria (n, n_torques) at torques (n_torques,) [N mm], one after the other.

        The modulus is the drawing's. ``start`` (n, n_motions) are poses near the first; see ``equilibrium.solve``.
        """
        return solve(self.elastic, self.gap, self.bearing_clearance, start, torque)

    def softened_equilibria(self, start: Real, torque: Real) -> Equilibria:
        """As ``equilibria`` (n, n_torques), each state with its modulus; the bearing's stiffness is as stated."""
        if self.modulus is None:
            return self.equilibria(start, torque)
        states = [
            solve(
                replace(
                    self.elastic,
                    laws=ContactLaws(**{name: values[k, 0] for name, values in vars(self.laws_of_states).items()}),
                    compliance=self.compliance / factor,
                ),
                self.gap[k : k + 1],
                self.bearing_clearance[k : k + 1],
                start[k : k + 1],
                torque,
            )
            for k, factor in enumerate(self.modulus)
        ]
        return Equilibria(
            **{name: np.concatenate([getattr(state, name) for state in states]) for name in vars(states[0])}
        )


@dataclass(frozen=True)
class Backbone:
    """Frictionless curve of a drive in its ``n`` states.

    Attributes
    ----------
    torque : (n_nodes,) ascending [N mm], symmetric; the two next to zero stand for the ends of the play.
    angle : (n, n_nodes) rotation of the output [rad], the torsion included.
    states : equilibria at the nodes (n, n_nodes, ...).
    """

    torque: Real
    angle: Real
    states: Equilibria

    @property
    def influence(self) -> Real:
        """d angle / d gap (n, n_nodes, n_contacts) [rad/mm].

        Notes
        -----
        The least complementary energy V(T) under the torque T has dV/dT = angle and dV/d gap = force, so
        the influence of a gap on the angle is the slope of its force over the torque (Maxwell's reciprocity).
        """
        return self._over_torque(self.states.force)

    def _over_torque(self, values: Real) -> Real:
        """Derivative of ``values`` (n, n_nodes, ...) by the torque [N mm], from either side of the play."""
        middle = len(self.torque) // 2
        sides = (slice(None, middle), slice(middle, None))
        return np.concatenate([np.gradient(values[:, side], self.torque[side], axis=1) for side in sides], axis=1)

    def change(self, drive: Drive, neighbour: Drive) -> Real:
        """Change of the angle (n, n_nodes) [rad], to first order, from the ``drive`` of this curve to a ``near`` one.

        Gaps, compliance, laws, bearing and twist may differ.

        Notes
        -----
        By the energy of ``influence``: what each contact and the bearing give way more under the forces that they
        carry, times the slope of these over the torque.
        """
        force = self.states.force
        forces_of_samples = [
            of_drive.gap[:, None] + force @ of_drive.compliance + of_drive.laws.deflection(force)
            for of_drive in (neighbour, drive)
        ]
        change = np.sum(self._over_torque(force) * (forces_of_samples[0] - forces_of_samples[1]), axis=2)
        thrust = drive.reducer.thrust(force)
        held_drives = [
            of_drive.bearing.depth(thrust) + of_drive.clearance_of_disks[:, None] for of_drive in (neighbour, drive)
        ]
        twisted = neighbour.twist(self.torque) - drive.twist(self.torque)
        return change + np.sum(self._over_torque(thrust) * (held_drives[0] - held_drives[1]), axis=2) + twisted


def torque_levels(levels: int, reach: float) -> Real:
    """Shares of the rated torque up to ``reach`` (levels + 1,), quadratically denser towards zero, from ``NO_LOAD``."""
    steps = np.arange(1, levels) / (levels - 1)
    return np.concatenate([[NO_LOAD, 2 * NO_LOAD], reach * steps**2])


def first_poses(drive: Drive, pose: Real, torque: float) -> Real:
    """Poses (n, n_motions) beyond an end of play: each rotation closes a contact that carries ``torque`` [N mm]."""
    reducer = drive.reducer
    if not reducer.centred:
        return loaded_poses(drive.elastic, drive.gap, pose, torque)
    arms = np.abs(reducer.contact_jacobian[:, reducer.output_motion])
    carrier = int(np.argmax(arms))
    force = abs(torque) / arms[carrier]
    depth = drive.laws[carrier].deflection(force)[0] + drive.compliance[carrier, carrier] * force
    turn = np.sign(torque) * depth / arms[carrier]
    rotations = [i for i, motion in enumerate(reducer.motions) if motion.endswith("_phi")]
    senses = [1 if motion == reducer.output_motion else np.sign(reducer.flange_ratio) for motion in rotations]
    contact_pose = pose.copy()
    bodies_passed = np.maximum(np.arange(len(rotations)) + 2 - reducer.n_disks, 1)  # disks stand side by side
    contact_pose[:, rotations] += turn * np.array(senses) * bodies_passed
    return contact_pose


def _one_sense(drive: Drive, pose: Real, levels: Real, preloaded: bool) -> Equilibria:
    """Equilibria at torques [N mm] of one sense, the least first, from poses at an end of the play.

    Notes
    -----
    Contacts that interfere (``preloaded``) are many at no load and few at the last torque, and a loose disk is easily
    found under load, from where one without clearance stands: both are solved from the last torque down.
    """
    clearance, loose = drive.clearance_of_disks, bool(np.any(drive.clearance_of_disks))
    start = first_poses(drive, pose, levels[-1 if preloaded else 0])
    if loose and drive.reducer.centred:
        one_sided = replace(drive, known=drive.gap_of_errors, bearing_clearance=np.zeros_like(clearance))
        without_clearance = _one_sense(one_sided, pose, levels, preloaded)
        start = _loosened(drive.reducer, without_clearance.motion[:, -1], without_clearance.force[:, -1], clearance)
    downward = preloaded or loose
    states = drive.equilibria(start, levels[::-1] if downward else levels)
    return Equilibria(**{name: values[:, ::-1] for name, values in vars(states).items()}) if downward else states


def _loosened(reducer: Reducer, motion: Real, force: Real, clearance: Real) -> Real:
    """Poses (n, n_motions) once bearings without clearance get one [mm]: each disk falls on by its own.

    The rotations follow so that the contacts, weighted by their forces (n, n_contacts), stay as deep as they can.
    """
    translations = 2 * reducer.n_disks
    planar, rotations = reducer.planar, reducer.contact_jacobian[:, translations:]
    poses = motion.copy()
    shift = motion[:, :translations].reshape(len(motion), -1, 2)
    fall = (
        shift
        * (of_each_disk(clearance, reducer.n_disks) / np.maximum(np.hypot(shift[..., 0], shift[..., 1]), 1e-300))[
            ..., None
        ]
    )
    fall = fall.reshape(len(motion), -1)
    poses[:, :translations] += fall
    for k, weight in enumerate(np.sqrt(np.maximum(force, 0.0))):
        poses[k, translations:] -= np.linalg.lstsq(
            weight[:, None] * rotations, weight * (planar @ fall[k]), rcond=None
        )[0]
    return poses


def backbone(drive: Drive, shares: Real) -> Backbone:
    """The frictionless curve at +- the ``shares`` (n_levels,) of the rated torque, ascending from ``NO_LOAD``.

    Notes
    -----
    The play with the disk's centre held is near enough to start from; the program that knows the bearing's clearance
    takes 15 ms a state and is left to the states that find no equilibrium from there.
    """
    separated = separated_play(drive.reducer, drive.gap)
    torque = drive.rated_torque * shares
    preloaded = bool(np.any(separated.preloaded))
    senses = [
        _one_sense(drive, pose, sense * torque, preloaded)
        for sense, pose in ((-1.0, separated.pose_minus), (1.0, separated.pose_plus))
    ]
    hard = np.any(drive.clearance_of_disks > 0, axis=1) & ~np.all(
        [np.all(branch.converged, axis=1) for branch in senses], axis=0
    )
    if np.any(hard):
        remaining = drive.some(hard)
        coupled = rigid_play(drive.reducer, remaining.gap, remaining.bearing_clearance)
        for branch, sense, pose in zip(senses, (-1.0, 1.0), (coupled.pose_minus, coupled.pose_plus), strict=True):
            start = first_poses(remaining, pose, sense * torque[0])
            repeated = remaining.equilibria(start, sense * torque)
            for name, values in vars(branch).items():
                values[hard] = getattr(repeated, name)
    falling, rising = senses
    states = Equilibria(
        **{
            name: np.concatenate([getattr(falling, name)[:, ::-1], getattr(rising, name)], axis=1)
            for name in vars(falling)
        }
    )
    torques = np.concatenate([-torque[::-1], torque])
    return Backbone(torques, states.motion[..., drive.reducer.output_motion] + drive.twist(torques), states)
