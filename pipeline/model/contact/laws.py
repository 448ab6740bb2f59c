"""Force laws of single contacts: local deflection against force, and what they leave to the mesh.

A law gives the local deflection delta [mm] of a closed contact under the force F [N]; the dead zone is
the clearance, which the equilibrium adds. Every law is

    delta(F) = a F - c F ln(F) + k F^m     for F <= force_limit, the tangent beyond,

so one record of numbers per contact (``ContactLaws``) serves the solver, the tables and the checks. The laws
themselves are in ``line_laws``, one file each.

Source: Johnson, Contact Mechanics (1985), ch. 4 and 5.6.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import lambertw

from pipeline.arrays import Index, Real, Truth

SHARE_OF_LIMIT = 0.9
"""The tangent continues a law at this share of the force at which its slope would vanish."""

HERTZ_SHORTFALL = 0.1
"""Coefficient of the logarithm in Hertz' law of two bodies over their secant compliance: 0.09 to 0.12."""

SMALLEST_DEFLECTION = 1e-100
"""Deflection [mm] from which a law is inverted; below it forces underflow."""


@dataclass(frozen=True)
class Material:
    """Isotropic elastic material in a state of plane stress or plane strain.

    Attributes
    ----------
    youngs_modulus : float
        [MPa]
    poisson_ratio : float
    stress : str
        ``"plane_stress"`` or ``"plane_strain"``.
    """

    youngs_modulus: float
    poisson_ratio: float
    stress: str

    @property
    def modulus(self) -> float:
        """E' [MPa]: E in plane stress, E/(1 - nu^2) in plane strain."""
        return self.youngs_modulus if self.stress == "plane_stress" else self.strain_modulus

    @property
    def strain_modulus(self) -> float:
        """E/(1 - nu^2) [MPa], in either state."""
        return self.youngs_modulus / (1 - self.poisson_ratio**2)

    @property
    def lateral(self) -> float:
        """nu' [-]: nu in plane stress, nu/(1 - nu) in plane strain."""
        if self.stress == "plane_stress":
            return self.poisson_ratio
        return self.poisson_ratio / (1 - self.poisson_ratio)


@dataclass(frozen=True)
class ContactLaws:
    """Laws of ``n`` contacts, each array (n,).

    Attributes
    ----------
    linear : a [mm/N]
    logarithmic : c [mm/N]
    power : k [mm/N^m]
    exponent : m [-]
    force_limit : largest force of the law proper [N]; the tangent continues it.
    pressure : peak Hertz pressure is ``pressure * sqrt(F)`` [MPa/sqrt(N)].
    """

    linear: Real
    logarithmic: Real
    power: Real
    exponent: Real
    force_limit: Real
    pressure: Real

    def __len__(self) -> int:
        return len(self.linear)

    def __getitem__(self, index: int | slice | Index | Truth) -> "ContactLaws":
        return ContactLaws(*(np.atleast_1d(getattr(self, name)[index]) for name in NUMBERS))

    @property
    def content(self) -> bytes:
        """All numbers of the laws: those of equal laws are equal."""
        return b"".join(getattr(self, name).tobytes() for name in NUMBERS)

    def _proper_deflection(self, force: Real) -> Real:
        log = np.log(np.maximum(force, np.finfo(float).tiny))
        return force * (self.linear - self.logarithmic * log) + self.power * force**self.exponent

    def _proper_compliance(self, force: Real) -> Real:
        positive_force = np.maximum(force, np.finfo(float).tiny)
        log = np.log(positive_force)
        growth = self.power * self.exponent * positive_force ** (self.exponent - 1)
        power_part: Real = np.where(self.power > 0, growth, 0.0)
        compliance: Real = self.linear - self.logarithmic * (1 + log) + power_part
        return compliance

    def deflection(self, force: ArrayLike) -> Real:
        """Local deflection [mm] at ``force`` (..., n) [N], zero at and below zero force."""
        force = np.maximum(np.asarray(force, float), 0.0)
        proper_force = np.minimum(force, self.force_limit)
        proper, further_force = self._proper_deflection(proper_force), force - proper_force
        further = further_force * self._proper_compliance(proper_force) if np.any(further_force) else 0.0
        return np.asarray(proper + further, float)

    def compliance(self, force: ArrayLike) -> Real:
        """Tangent d delta / dF [mm/N] at ``force`` (..., n) [N]; positive everywhere."""
        return self._proper_compliance(np.minimum(np.asarray(force, float), self.force_limit))

    def force(self, deflection: ArrayLike) -> Real:
        """Force [N] at the local ``deflection`` (..., n) [mm]; zero in the dead zone (deflection <= 0).

        Notes
        -----
        delta(F) is concave: from below its root Newton rises to it step by step; from above it falls below it, or by
        nine tenths if it would leave the positive forces. It stops at a relative step of 1e-15.

        Raises
        ------
        ArithmeticError
            If 100 iterations do not settle to 1e-12, with the deflections at fault.
        """
        deflection = np.asarray(deflection, float)
        target = np.maximum(deflection, SMALLEST_DEFLECTION)
        force = target / self.compliance(np.ones_like(target))
        for _ in range(100):
            rise = (target - self.deflection(force)) / self.compliance(force)
            is_settled = np.abs(rise) <= 1e-15 * force
            if np.all(is_settled):
                break
            force = np.maximum(force + rise, 0.1 * force)
        is_unsettled = np.abs(rise) > 1e-12 * force
        if np.any(is_unsettled):
            at_fault = np.broadcast_to(deflection, is_unsettled.shape)[is_unsettled]
            raise ArithmeticError(f"force law not inverted at deflections {at_fault} mm")
        return np.where(deflection > 0, force, 0.0)

    def energy(self, force: ArrayLike) -> Real:
        """Complementary energy, the integral of delta over F from 0 [N mm]."""
        force = np.maximum(np.asarray(force, float), 0.0)
        proper_force = np.minimum(force, self.force_limit)
        log = np.log(np.maximum(proper_force, np.finfo(float).tiny))
        higher = self.exponent + 1
        proper = (
            0.5 * proper_force**2 * (self.linear - self.logarithmic * (log - 0.5))
            + self.power * proper_force**higher / higher
        )
        excess = force - proper_force
        at_limit, slope = self._proper_deflection(proper_force), self._proper_compliance(proper_force)
        return np.asarray(proper + excess * at_limit + 0.5 * excess**2 * slope, float)

    def peak_pressure(self, force: ArrayLike) -> Real:
        """Peak Hertz pressure [MPa] at ``force`` (..., n) [N]."""
        pressure: Real = self.pressure * np.sqrt(np.maximum(np.asarray(force, float), 0.0))
        return pressure


NUMBERS = tuple(field.name for field in fields(ContactLaws))
"""Of every contact in its law, one each."""


def in_series(laws: ContactLaws, second: ContactLaws) -> ContactLaws:
    """Laws of contacts in series under one force (n,): their deflections add up.

    Raises
    ------
    ValueError
        If both have a power of the force and not the same.
    """
    pair = (laws.power > 0) & (second.power > 0)
    if np.any(pair & (laws.exponent != second.exponent)):
        raise ValueError("laws of two different powers of the force are no such law in series")
    return ContactLaws(
        linear=laws.linear + second.linear,
        logarithmic=laws.logarithmic + second.logarithmic,
        power=laws.power + second.power,
        exponent=np.where(laws.power > 0, laws.exponent, second.exponent),
        force_limit=np.minimum(laws.force_limit, second.force_limit),
        pressure=np.maximum(laws.pressure, second.pressure),
    )


def scaled_laws(laws: ContactLaws, factor: ArrayLike) -> ContactLaws:
    """Laws whose deflections are ``factor``, one or (n,), times those of others."""
    numbers = {name: factor * getattr(laws, name) for name in ("linear", "logarithmic", "power")}
    return replace(laws, **numbers)


def curved_laws(laws: ContactLaws, factor: float, usual_force: ArrayLike) -> ContactLaws:
    """Laws that fall ``factor`` times as far behind a linear one as others do.

    At a usual force [N], one or (n,), they are alike. Of a power m of the force 1 - m is multiplied: a factor of 3 is
    an exponent of 0.7 for Palmgren's 0.9, one of 0.3 is 0.97. Of Hertz' law the logarithm is multiplied by a factor
    below 1; one above 1 replaces the share 1 - 1/factor^2 of it by a power that falls behind as far as is needed, so
    that it tends to the same power (of 0.7 at 3). Linear laws stay as they are. The law ends where its slope would
    vanish, or where the other ends.
    """
    if factor == 1.0:
        return laws
    usual, is_hertz = np.asarray(usual_force, float), laws.logarithmic > 0
    replaced = max(1 - factor**-2, 0.0) * laws.logarithmic
    logarithmic = laws.logarithmic - replaced if factor > 1 else factor * laws.logarithmic
    secant = replaced / HERTZ_SHORTFALL
    shortfall = np.where(
        is_hertz, HERTZ_SHORTFALL * (factor**2 + factor + 1) / (factor + 1), factor * (1 - laws.exponent)
    )
    exponent = np.where((laws.power > 0) | (replaced > 0), 1 - shortfall, laws.exponent)
    power = laws.power * usual ** (laws.exponent - exponent) + secant * usual ** (1 - exponent)
    linear = laws.linear - secant + (logarithmic - laws.logarithmic) * np.log(usual)
    limit = np.minimum(laws.force_limit, SHARE_OF_LIMIT * _vanishing_slope(linear, logarithmic, power, exponent))
    return replace(laws, linear=linear, logarithmic=logarithmic, power=power, exponent=exponent, force_limit=limit)


def _vanishing_slope(linear: Real, logarithmic: Real, power: Real, exponent: Real) -> Real:
    """Force (n,) [N] at which the slope of a F - c F ln(F) + k F^m vanishes, infinite where it does not.

    With u = ln(F) - (a - c)/c it vanishes at (1 - m) u = W((1 - m) m k/c e^(-(1 - m)(a - c)/c)), Lambert's W.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        start = linear / logarithmic - 1
        argument = (1 - exponent) * exponent * power / logarithmic * np.exp(-(1 - exponent) * start)
        further = np.where(power > 0, lambertw(argument).real / (1 - exponent), 0.0)
        of_logarithm = np.where(logarithmic > 0, np.exp(start + further), np.inf)
        of_mesh = (logarithmic == 0) & (power > 0) & (linear < 0)
        of_power = np.where(of_mesh, (power * exponent / -linear) ** (1 / (1 - exponent)), np.inf)
    force: Real = np.minimum(of_logarithm, of_power)
    return force


def stiffened_laws(laws: ContactLaws, factor: Real) -> ContactLaws:
    """Laws of bodies whose moduli are ``factor`` (..., n) times those of others, (..., n) each.

    At as many times the force they have the same deflection. A linear law is a stated stiffness, and is left as it is.
    """
    is_stated = (laws.logarithmic == 0) & (laws.power == 0)
    return ContactLaws(
        linear=np.where(is_stated, laws.linear, (laws.linear + laws.logarithmic * np.log(factor)) / factor),
        logarithmic=laws.logarithmic / factor,
        power=laws.power / factor**laws.exponent,
        exponent=laws.exponent + np.zeros_like(factor),
        force_limit=laws.force_limit * factor,
        pressure=laws.pressure * np.sqrt(factor),
    )


def concatenated_laws(laws: list[ContactLaws]) -> ContactLaws:
    """The laws of several groups of contacts in one record, in the order given."""
    return ContactLaws(*(np.concatenate([getattr(group, name) for group in laws]) for name in NUMBERS))


def no_laws() -> ContactLaws:
    """The laws of no contacts."""
    empty = np.zeros(0)
    return ContactLaws(empty, empty, empty, empty, empty, empty)


@dataclass(frozen=True)
class LineContact:
    """Hertz line contact of two bodies of one material each, ``n`` contacts of one length.

    Attributes
    ----------
    radius : relative radius of curvature R' (n,) [mm], 1/R' = sum of the curvatures.
    length : contact length [mm].
    first_material, second_material : the two materials.
    """

    radius: Real
    length: float
    first_material: Material
    second_material: Material

    @property
    def contact_modulus(self) -> float:
        """E* [MPa], 1/E* = 1/E'_1 + 1/E'_2."""
        return 1 / (1 / self.first_material.modulus + 1 / self.second_material.modulus)

    @property
    def log_half_width(self) -> Real:
        """ln b at a force of 1 N (n,), b in mm; ln b = this + ln(F)/2."""
        return 0.5 * np.log(4 * self.radius / (np.pi * self.contact_modulus * self.length))

    def half_width(self, force: ArrayLike) -> Real:
        """Half width b = sqrt(4 p R'/(pi E*)) [mm] at ``force`` (..., n) [N]."""
        half_width: Real = np.exp(self.log_half_width) * np.sqrt(np.asarray(force, float))
        return half_width

    @property
    def pressure_factor(self) -> Real:
        """Peak pressure sqrt(p E*/(pi R')) at 1 N (n,) [MPa/sqrt(N)], 1/E* = sum of (1 - nu^2)/E (Johnson 1985, 4.2).

        A contact is much longer than wide, so that it is in plane strain whatever the state of the bodies, and limits
        of the pressure are stated for that.
        """
        give = 1 / self.first_material.strain_modulus + 1 / self.second_material.strain_modulus
        return np.sqrt(1 / (give * np.pi * self.radius * self.length))

    def share(self, material: Material, log_length: ArrayLike, constant: float) -> tuple[Real, Real]:
        """Coefficients (a, c) of one body's deflection (2p/(pi E')) [ln(lambda/b) + constant].

        ``log_length`` is ln(lambda), the length that the body's share of the field is cut off at.
        """
        scale = 2 / (np.pi * material.modulus * self.length)
        return scale * (np.asarray(log_length) + constant - self.log_half_width), np.full(
            self.radius.shape, 0.5 * scale
        )


def cylinder_share(contact: LineContact, material: Material, radius: float) -> tuple[Real, Real]:
    """A body that is a cylinder between contact and axis: (2p/(pi E')) [ln(4 r/b) - 1/2] (Johnson 5.57)."""
    return contact.share(material, np.log(4 * radius), -0.5)


def meshed_share(contact: LineContact, material: Material, patch_half_width: float) -> tuple[Real, Real]:
    """What a mesh loaded over the half width w cannot hold: (2p/(pi E')) [ln(w/b) + 1/4].

    The work-conjugate mean displacement of an elliptical pressure of half width w at the depth d is
    (2p/(pi E')) [ln(2d/w) - 1/4 - nu'/2]; the Hertz approach takes the centre of the half width b,
    ln(2d/b) - nu'/2. Their difference is this correction, whatever the mesh and w.
    """
    return contact.share(material, np.log(patch_half_width), 0.25)


def flat_share(contact: LineContact, material: Material, depth: float) -> tuple[Real, Real]:
    """A flat body down to the depth d: (2p/(pi E')) [ln(2 d/b) - nu'/2] (Johnson 1985, 5.6)."""
    return contact.share(material, np.log(2 * depth), -0.5 * material.lateral)


def mesh_compliance(material: Material, length: float, depth: float, patch_half_width: float) -> float:
    """Mean deflection per force [mm/N] of a half-plane's patch of half width w down to the depth d.

    (2/(pi E' L)) [ln(2d/w) - 1/4 - nu'/2], Johnson 1985, 5.6, averaged with the elliptical pressure.
    """
    return float(
        2 / (np.pi * material.modulus * length) * (np.log(2 * depth / patch_half_width) - 0.25 - 0.5 * material.lateral)
    )
