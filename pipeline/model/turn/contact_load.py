"""What single contacts bear while a torque is held: shear below the surface, pressure times speed, friction."""

from dataclasses import dataclass

import numpy as np

from pipeline.model.contact.laws import ContactLaws
from pipeline.model.geometry.cycloid_profile import Real

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
