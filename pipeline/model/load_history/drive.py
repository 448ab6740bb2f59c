"""A reducer as it is mounted: errors, springs, and the elements beside it (``pipeline.model.elements``).

A drive is one crank angle of one reducer, its gaps in ``n`` states (the samples of a study, or the cycles of a
measured unit). Effects (``pipeline.model.effects``) are functions from drive to drive.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipeline.arrays import Real
from pipeline.model.contact.friction_elements import Sliders
from pipeline.model.contact.laws import ContactLaws, stiffened_laws
from pipeline.model.elements import ElasticModulus, Element, Friction, Hysteresis, Spring
from pipeline.model.equilibrium.solve import ElasticReducer, Equilibria, solve
from pipeline.model.geometry.clearance import Errors, gaps
from pipeline.model.geometry.cycloid_profile import CycloidProfile
from pipeline.model.geometry.reducer import Bearing, Reducer, of_each_disk
from pipeline.model.geometry.rigid_play.finite_motion import backlash_change

NO_TORQUE = np.array([-0.0, 0.0])
"""The limits of no torque from below and from above [N mm]."""


@dataclass(frozen=True)
class GapReading:
    """How errors become gaps; the arguments of ``clearance.gaps``."""

    method: str
    disk_reading: str
    roller_reading: str


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
    elements : what acts beside the reducer; those in series with the output in their order from the reducer.
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
    elements: tuple[Element, ...] = ()
    known_gap: Real | None = None

    @cached_property
    def gap_of_errors(self) -> Real:
        """Gap that the errors alone leave (n, n_contacts) [mm]."""
        if self.known_gap is not None:
            return self.known_gap
        return gaps(self.profile, self.reducer, self.errors, **vars(self.reading))

    @property
    def _found_gap(self) -> Real | None:
        """``gap_of_errors`` where it has been computed."""
        gap: Real | None = self.__dict__.get("gap_of_errors", self.known_gap)
        return gap

    @cached_property
    def gap(self) -> Real:
        """Gap of every contact at the nominal pose (n, n_contacts) [mm]."""
        return self.gap_of_errors + self.shift

    @property
    def backlash_change(self) -> Real:
        """What finite motions add to the backlash of small ones (n,) [rad]; see ``finite_motion.backlash_change``."""
        reading = self.reading.disk_reading
        return backlash_change(self.profile, self.reducer, self.errors, reading, self.gap, self.bearing_clearance)

    @cached_property
    def first_state(self) -> "Drive":
        """The drive in its first state alone."""
        return self.some(slice(1))

    def some(self, states: np.ndarray | slice) -> "Drive":
        """The drive in some of its states."""
        return replace(
            self,
            errors=Errors(**{name: values[states] for name, values in vars(self.errors).items()}),
            shift=self.shift[states],
            bearing_clearance=self.bearing_clearance[states],
            elements=tuple(element.some(states) for element in self.elements),
            known_gap=self.gap_of_errors[states],
        )

    @cached_property
    def springs(self) -> tuple[Spring, ...]:
        """Elements in series with the output that have no memory."""
        return tuple(element for element in self.elements if isinstance(element, Spring))

    @cached_property
    def hystereses(self) -> tuple[Hysteresis, ...]:
        """Elements in series with the output that have a memory."""
        return tuple(element for element in self.elements if isinstance(element, Hysteresis))

    @cached_property
    def frictions(self) -> tuple[Friction, ...]:
        """Elements in parallel with the output or at the contacts."""
        return tuple(element for element in self.elements if isinstance(element, Friction))

    @cached_property
    def sliders(self) -> Sliders:
        """Friction of all elements."""
        sliders = Sliders.none()
        for element in self.frictions:
            sliders = sliders.with_others(element.sliders)
        return sliders

    @cached_property
    def lean(self) -> float:
        """Difference of the friction between the two senses of motion; see ``Friction.lean``."""
        return sum(element.lean for element in self.frictions)

    @cached_property
    def modulus(self) -> Real | None:
        """Factor (n,) of the modulus of all elastic parts in each state, or None for 1."""
        factors = [element.factor for element in self.elements if isinstance(element, ElasticModulus)]
        return np.prod(factors, axis=0) if factors else None

    @property
    def bearing_of_states(self) -> list[Bearing]:
        """The input bearing of each state (n,), with the modulus where that is the bearing's too."""
        factor = np.ones(len(self.bearing_clearance))
        for element in self.elements:
            if isinstance(element, ElasticModulus) and element.of_bearing:
                factor = factor * element.factor
        return [replace(self.bearing, stiffness=self.bearing.stiffness * share) for share in factor.tolist()]

    @cached_property
    def laws_of_states(self) -> ContactLaws:
        """Laws of the contacts with each state's modulus, (n, 1, n_contacts) each; where that is 1, the laws."""
        return self.laws if self.modulus is None else stiffened_laws(self.laws, self.modulus[:, None, None])

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
        """Rotation [rad] of all springs in series with the output under the torque [N mm] on it.

        0.0 and -0.0 are the limits from above and from below.
        """
        twist = np.zeros(np.shape(torque))
        for spring in self.springs:
            twist = twist + spring.twist(torque)
        return twist

    @property
    def clearance_of_disks(self) -> Real:
        """Clearance of each disk's bearing (n, n_disks) [mm]."""
        return of_each_disk(self.bearing_clearance, self.reducer.n_disks)

    @property
    def without_elements(self) -> "Drive":
        """The drive without elements: the modulus is the drawing's."""
        return replace(self, elements=(), known_gap=self._found_gap)

    def at_drawing_modulus(self, state: int) -> "Drive":
        """The drive whose friction is to the modulus of the drawing as its own is to that of a state."""
        factor = self.stiffening(state)
        if factor == 1.0:
            return self
        scaled_elements = (
            element.at_drawing_modulus(factor) if isinstance(element, Friction) else element
            for element in self.elements
        )
        return replace(self, elements=tuple(scaled_elements), known_gap=self._found_gap)

    def with_added_gap(self, added_gap: Real) -> "Drive":
        """The drive with every gap larger by ``added_gap`` (n, n_contacts) [mm]."""
        return replace(self, shift=self.shift + added_gap, known_gap=self._found_gap)

    def with_elements(self, *elements: Element) -> "Drive":
        """The drive with elements beside its own."""
        return replace(self, elements=(*self.elements, *elements), known_gap=self._found_gap)

    def with_added_errors(self, **errors: Real) -> "Drive":
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
        """As ``equilibria`` (n, n_torques), each state with its modulus."""
        if self.modulus is None:
            return self.equilibria(start, torque, neighbours)
        states = []
        for k, (factor, bearing) in enumerate(zip(self.modulus, self.bearing_of_states, strict=True)):
            laws = stiffened_laws(self.laws, np.full(len(self.laws), factor))
            elastic = replace(self.elastic, bearing=bearing, laws=laws, compliance=self.compliance / factor)
            state = slice(k, k + 1)
            near = None if neighbours is None else neighbours[state]
            states.append(solve(elastic, self.gap[state], self.bearing_clearance[state], start[state], torque, near))
        return Equilibria.concatenate(states, axis=0)
