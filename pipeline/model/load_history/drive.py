"""A reducer as it is mounted: errors, springs, friction and what lies between its output and the torque.

A drive is one crank angle of one reducer, its gaps in ``n`` states (the samples of a study, or the cycles of a
measured unit). Effects (``pipeline.model.effects``) are functions from drive to drive.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pipeline.model.contact.friction_elements import Sliders
from pipeline.model.contact.laws import ContactLaws, stiffened
from pipeline.model.equilibrium.solve import ElasticReducer, Equilibria, solve
from pipeline.model.geometry.clearance import Errors, gaps
from pipeline.model.geometry.cycloid_profile import CycloidProfile, Real
from pipeline.model.geometry.reducer import Bearing, Reducer, of_each_disk


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
    known_gap : gap of the errors alone (n, n_contacts) [mm], where it was found before.
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
    known_gap: Real | None = None

    @cached_property
    def gap_of_errors(self) -> Real:
        """Gap that the errors alone leave (n, n_contacts) [mm]."""
        if self.known_gap is not None:
            return self.known_gap
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
            known_gap=self.gap_of_errors[states],
        )

    @cached_property
    def laws_of_states(self) -> ContactLaws:
        """Laws of the contacts with each state's modulus, (n, 1, n_contacts) each; where that is 1, the laws."""
        return self.laws if self.modulus is None else stiffened(self.laws, self.modulus[:, None, None])

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
        return replace(self, torsion=0.0, hardening=None, known_gap=self.gap_of_errors)

    def shifted(self, added_gap: Real) -> "Drive":
        """The drive with every gap larger by ``more`` (n, n_contacts) [mm]."""
        return replace(self, shift=self.shift + added_gap, known_gap=self.gap_of_errors)

    def with_friction(self, sliders: Sliders) -> "Drive":
        """The drive with sliders beside its own."""
        return replace(self, sliders=self.sliders.joined(sliders))

    def moved(self, **errors: Real) -> "Drive":
        """The drive with errors [mm] added to its own, by their names; broadcast to the errors' shapes."""
        return self.with_errors(
            replace(self.errors, **{name: getattr(self.errors, name) + shift for name, shift in errors.items()})
        )

    def with_errors(self, errors: Errors) -> "Drive":
        """The drive with other errors."""
        return replace(self, errors=errors, known_gap=None)

    @cached_property
    def elastic(self) -> ElasticReducer:
        """The reducer on its springs, their modulus the drawing's."""
        return ElasticReducer(self.reducer, self.bearing, self.laws, self.compliance)

    def equilibria(self, start: Real, torque: Real, neighbours: Equilibria | None = None) -> Equilibria:
        """Frictionless equilibria (n, n_torques) at torques (n_torques,) [N mm], one after the other.

        The modulus is the drawing's. ``start`` (n, n_motions) are poses near the first, ``neighbours`` (n,) those of
        drives that differ little; see ``equilibrium.solve``.
        """
        return solve(self.elastic, self.gap, self.bearing_clearance, start, torque, neighbours)

    def softened_equilibria(self, start: Real, torque: Real, neighbours: Equilibria | None = None) -> Equilibria:
        """As ``equilibria`` (n, n_torques), each state with its modulus; the bearing's stiffness is as stated."""
        if self.modulus is None:
            return self.equilibria(start, torque, neighbours)
        states = [
            solve(
                replace(
                    self.elastic,
                    laws=stiffened(self.laws, np.full(len(self.laws), factor)),
                    compliance=self.compliance / factor,
                ),
                self.gap[k : k + 1],
                self.bearing_clearance[k : k + 1],
                start[k : k + 1],
                torque,
                None if neighbours is None else neighbours[k : k + 1],
            )
            for k, factor in enumerate(self.modulus)
        ]
        return Equilibria.joined(states, axis=0)
