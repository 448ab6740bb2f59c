"""Manufacturing errors to the raw gaps of every contact at the nominal pose, before any take-up.

Gaps are (n_samples, n_contacts) [mm]; a negative gap is an interference (preload) and legal.
"""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.arrays import Complex, Index, Real
from pipeline.model.compiled import entry
from pipeline.model.geometry.contacts import Contacts, DiskPose
from pipeline.model.geometry.cycloid_profile import NOMINAL, CycloidProfile, pin_lobes
from pipeline.model.geometry.deviating_distances import deviating_distances
from pipeline.model.geometry.drawn_flank import deviation_table, material_off
from pipeline.model.geometry.foot_points import pin_distances, valleys
from pipeline.model.geometry.out_of_round import ORDERS, exact_closing, first_order_closing
from pipeline.model.geometry.reducer import Reducer

DISK_READINGS = {"radial": 1.0, "radial_on_diameter": 0.5, "normal": 1.0}
"""What a disk profile error of 1 is at the flank: a shift of the pin circle that generates it (radial; half of
it if the error is a size on the diameter), or material taken off along the normal."""
ROLLER_READINGS = {"diameter": 1.0, "half_diameter": 0.5}
"""Gap per missing roller diameter: all of it, or the half on each side of a roller that lies centred."""


@dataclass(frozen=True)
class Errors:
    """Manufacturing errors of ``n`` samples [mm]; signs as in the study file.

    Attributes
    ----------
    pin_radial, pin_tangential, pin_radius : (n, n_pins); outward, counterclockwise, larger positive.
    lobe : (n, n_lobes) of all disks alike, or (n, n_disks, n_lobes): material off each lobe's flank, the uniform part
        included.
    eccentricity : (n,) or (n, n_disks) larger positive.
    roller_diameter : (n, n_rollers) larger positive, in the order of the output contacts: rollers, or output pins,
        which reach through all disks.
    lobe_pitch : (n, n_lobes) or (n, n_disks, n_lobes): way of each lobe around the disk's axis along the circle at half
        of the lobes' height, counterclockwise positive.
    bore_runout : (n, 2) or (n, n_disks, 2) way of the flank's centre from the bore's in the disk's frame.
    eccentric_phase : (n,) or (n, n_disks) way of the eccentric's centre around the crank, counterclockwise positive.
    hole_diameter : (n, n_holes) or (n, n_disks, n_holes) of holes about output pins or cranks, larger positive.
    pin_off_hole : (n, n_holes) or (n, n_disks, n_holes) complex, way of each output pin's axis from its true place
        against that of its hole, in the frame that turns with the output.
    pin_roundness : (n, n_pins, 2) complex, waves of order 2 and 3 around each pin: its radius in the direction theta is
        larger by the real part of the first times exp(2 i theta) and of the second times exp(3 i theta).
    displacement : (n, n_elements) complex, of the elements in ``Reducer.displacements``, one dimension after the other
        in its order; (n, 0) without any.
    """

    pin_radial: Real
    pin_tangential: Real
    pin_radius: Real
    lobe: Real
    eccentricity: Real
    roller_diameter: Real
    eccentric_phase: Real
    lobe_pitch: Real
    bore_runout: Real
    hole_diameter: Real
    pin_off_hole: Complex
    pin_roundness: Complex
    displacement: Complex

    @classmethod
    def zero(cls, pins: int, lobes: int, outputs: int, n: int = 1) -> "Errors":
        """No errors in ``n`` samples, of so many pins, lobes and output contacts of a disk."""
        widths = {"pin_radial": pins, "pin_tangential": pins, "pin_radius": pins, "lobe": lobes, "lobe_pitch": lobes}
        widths |= {"roller_diameter": outputs, "bore_runout": 2, "hole_diameter": outputs}
        values = {name: np.zeros((n, width)) for name, width in widths.items()}
        return cls(
            **values,
            eccentricity=np.zeros(n),
            eccentric_phase=np.zeros(n),
            pin_off_hole=np.zeros((n, outputs), complex),
            pin_roundness=np.zeros((n, pins, len(ORDERS)), complex),
            displacement=np.zeros((n, 0), complex),
        )

    def of_disk(self, disk: int) -> "Errors":
        """The errors as one disk meets them: its own, and those of the parts that all disks share."""
        own = {name: getattr(self, name) for name in _SHARED_AXES}
        own = {name: values[:, disk] for name, values in own.items() if values.ndim > _SHARED_AXES[name]}
        return replace(self, **{name: np.ascontiguousarray(values) for name, values in own.items()}) if own else self


def after_turns(errors: Errors, lobes: int) -> Errors:
    """One unit after 0, 1, ... turns of the crank as ``lobes`` units at the same crank angle, one disk in each.

    Notes
    -----
    With every turn the disk goes on by a lobe, clockwise, as its lobes are numbered: a pin meets the lobe before the
    last one, and the flank's run-out has turned with the disk.
    """
    repeated_errors = {name: np.repeat(values, lobes, axis=0) for name, values in vars(errors).items()}
    rolled_errors = {name: np.stack([np.roll(getattr(errors, name)[0], k) for k in range(lobes)]) for name in _OF_LOBES}
    turned_runout = (errors.bore_runout @ np.array([1, 1j])) * np.exp(-2j * np.pi * np.arange(lobes) / lobes)
    turned_errors = {"bore_runout": np.stack([turned_runout.real, turned_runout.imag], axis=1)}
    return Errors(**(repeated_errors | rolled_errors | turned_errors))


_OF_LOBES = ("lobe", "lobe_pitch")
"""Errors of each lobe."""
_SHARED_AXES = {"lobe": 2, "eccentricity": 1, "eccentric_phase": 1, "lobe_pitch": 2, "bore_runout": 2}
_SHARED_AXES |= {"hole_diameter": 2, "pin_off_hole": 2}
"""Axes of errors that all disks share; those of each disk have one more, the second."""


def _lobe_turns(profile: CycloidProfile, errors: Errors) -> Real:
    """Rotation of each lobe about the disk's axis by its pitch error (n, n_lobes) [rad], counterclockwise positive."""
    return errors.lobe_pitch / (profile.pin_circle_radius - profile.pin_radius)


def first_order_gaps(profile: CycloidProfile, reducer: DiskPose | Reducer, errors: Errors, disk_reading: str) -> Real:
    """Gaps of the pins to first order in the errors, (n, n_pins) [mm].

    Notes
    -----
    -n.dA - ds + w + n.u de + l t, with l the arm of the normal about the disk's axis and t the turn of the lobe by its
    pitch error, and w the material off the flank: of the errors, and of the drawing, dr + dR n.rho with
    rho the radial direction, and what its rotation and a measured deviation take off. Fails at the roots, where the
    pin centre lies close to the evolute of the flank. Where a root separates unequal lobes the nearer flank counts.
    """
    pins = reducer.pins
    radial = pins.centre / np.abs(pins.centre)
    radial_part = np.real(np.conj(pins.normal) * radial)
    tangential_part = np.real(np.conj(pins.normal) * 1j * radial)
    eccentric = np.real(np.conj(pins.normal) * np.exp(1j * reducer.crank))
    lobe_before, lobe_behind = pin_lobes(profile, reducer.pins)
    at_root = np.isclose(pins.phase, 0.0, atol=1e-9)
    met_flank = np.where(pins.phase < 0, lobe_before, lobe_behind)
    lobe, radial_error, tangential_error, radius_error, eccentricity = map(
        np.ascontiguousarray,
        (errors.lobe, errors.pin_radial, errors.pin_tangential, errors.pin_radius, errors.eccentricity),
    )
    lobe_error = np.ones(len(radial_part)) if disk_reading == "normal" else -radial_part
    gap = _first_order_gaps(
        DISK_READINGS[disk_reading],
        (lobe, np.where(at_root, lobe_before, met_flank), np.where(at_root, lobe_behind, met_flank), lobe_error),
        (radial_error, tangential_error, radius_error, eccentricity),
        (radial_part, tangential_part, eccentric),
    )
    gap += pins.arm * _lobe_turns(profile, errors)[:, met_flank]
    return gap if profile.modification == NOMINAL else gap + modification_gaps(profile, reducer)


def modification_gaps(profile: CycloidProfile, disk: DiskPose | Reducer) -> Real:
    """Gap of each pin (n_pins,) [mm] along its normal by what the drawing takes off the flank that the pins generate.

    Source
    ------
    To first order dr + dR n.rho + |a| delta: Li and Guan, as in ``docs/mechanics.md``.
    """
    pins, modification = disk.pins, profile.modification
    lobe_before, lobe_behind = pin_lobes(profile, pins)
    radial_part = np.real(np.conj(pins.normal) * pins.centre / np.abs(pins.centre))
    deviation = material_off(profile, np.where(pins.phase < 0, lobe_before, lobe_behind), pins.phase)
    gap: Real = modification.equidistant + modification.moved_distance * radial_part + deviation
    return gap


@entry
def _first_order_gaps(
    factor: float,
    lobes: tuple[Real, Index, Index, Real],
    errors: tuple[Real, Real, Real, Real],
    directions: tuple[Real, Real, Real],
) -> Real:
    """See ``first_order_gaps``; lobes ``lobe_before`` and ``lobe_other`` of every pin: the nearer flank counts."""
    lobe, lobe_before, lobe_other, lobe_error = lobes
    (radial, tangential, radius, eccentricity), (cosine, sine, eccentric) = errors, directions
    n, n_pins = radial.shape
    gap = np.empty((n, n_pins))
    for s in range(n):
        for i in range(n_pins):
            lobe_gap = factor * min(lobe[s, lobe_before[i]], lobe[s, lobe_other[i]]) * lobe_error[i]
            pin_gap = lobe_gap - cosine[i] * radial[s, i] - sine[i] * tangential[s, i]
            gap[s, i] = pin_gap - radius[s, i] + eccentric[i] * eccentricity[s]
    return gap


def exact_gaps(profile: CycloidProfile, reducer: DiskPose | Reducer, errors: Errors, disk_reading: str) -> Real:
    """Signed distance of each actual pin from the actual flank, as drawn and with its errors, (n, n_pins) [mm].

    The foot point is searched over both flanks of the valley in which the pin lies, and over its tips; each lobe
    has the flank of its own error.

    Notes
    -----
    With ``radial`` readings a lobe's flank is generated by a pin circle smaller by its error, with
    ``normal`` it is the parallel of the drawn flank.
    """
    pins, flank = reducer.pins, profile.generating
    lobe_before, lobe_behind = pin_lobes(profile, reducer.pins)
    nominal = valleys(profile, reducer.crank)
    reading = DISK_READINGS[disk_reading]
    shares = (0.0, reading) if disk_reading == "normal" else (reading, 0.0)
    lobe, radial, tangential, eccentricity = map(
        np.ascontiguousarray, (errors.lobe, errors.pin_radial, errors.pin_tangential, errors.eccentricity)
    )
    displacements = radial, tangential, eccentricity, _lobe_turns(profile, errors)
    if profile.modification.deviates:
        distance = deviating_distances(
            profile, nominal, deviation_table(profile), shares, lobe, (lobe_before, lobe_behind), displacements
        )
    else:
        distance = pin_distances(
            nominal.pins,
            nominal.points,
            nominal.eccentric,
            (flank.pins, flank.pin_circle_radius, flank.pin_radius),
            shares,
            lobe,
            (np.where(pins.phase < 0, lobe_before, lobe_behind), lobe_before, lobe_behind),
            *displacements,
        )
    return distance - (profile.pin_radius + errors.pin_radius)


def output_gaps(contacts: Contacts, eccentricity: float, errors: Errors, roller_reading: str) -> Real:
    """Gaps of the output contacts of one disk, (n, n_output_contacts) [mm].

    Parameters
    ----------
    contacts : of the disk with the output.
    eccentricity : nominal [mm].
    errors : of the disk.
    """
    radius = eccentricity + errors.eccentricity
    phase_lift = np.hypot(radius, errors.eccentric_phase) - radius  # 0 of an eccentric in its direction
    share = np.where(contacts.two_sided, ROLLER_READINGS[roller_reading], 0.5)
    farther_travel = contacts.per_eccentricity * (errors.eccentricity + phase_lift)[:, None]
    return contacts.gap - share * errors.roller_diameter + farther_travel


def hole_gaps(contacts: Contacts, disk: DiskPose, errors: Errors, method: str) -> Real:
    """What errors of holes and of the output pins' places add to the gaps (n, n_contacts) [mm].

    Parameters
    ----------
    contacts : of the disk with the output, in its holes.
    disk : where it stands.
    errors : of the disk.
    method : ``"exact"`` or ``"first_order"``.

    Notes
    -----
    A hole's axis stands off its pin's by the eccentricity e along the contact's normal u; with the pin moved by v
    against the hole it is |e u - v|, to first order e - u.v. The normal turns by some v/e, which changes arms to second
    order and is left out. A ring of rollers about an eccentric pushes along directions of its own, so that its gaps
    are linear in v.
    """
    hole = contacts.hole
    travel: Complex = errors.pin_off_hole[:, hole] * np.exp(1j * disk.rotation) * np.conj(contacts.normal)
    if method == "exact" and np.any(contacts.per_eccentricity):
        radius = np.hypot(disk.eccentricity + errors.eccentricity, errors.eccentric_phase)[:, None]
        farther_travel = radius - np.abs(radius - travel)
    else:
        farther_travel = travel.real
    gap: Real = farther_travel + 0.5 * errors.hole_diameter[:, hole]
    return gap


def _with_pins_turned(disk: DiskPose, errors: Errors) -> Errors:
    """The errors of a disk with its eccentric where it belongs, and the pins moved against the way that it went.

    Notes
    -----
    Exact: only the way between a pin and the disk's centre counts, and the disk's rotation is a motion.
    """
    if not np.any(errors.eccentric_phase):
        return errors
    direction = np.conj(disk.pins.centre / np.abs(disk.pins.centre)) * -1j * np.exp(1j * disk.crank)
    return _with_pins_moved(errors, np.multiply.outer(errors.eccentric_phase, direction))


def _with_pins_off_centre(disk: DiskPose, errors: Errors) -> Errors:
    """The errors of a disk with its flank centred on the bore, and the pins moved against the way of the flank.

    Notes
    -----
    Exact: the way v is fixed in the disk, which turns by -crank / lobes; in the housing it is v exp(-i crank / lobes).
    Holes are made from the bore and keep their gaps.
    """
    if not np.any(errors.bore_runout):
        return errors
    centre_shift = (errors.bore_runout[:, 0] + 1j * errors.bore_runout[:, 1]) * np.exp(1j * disk.rotation)
    travel = -np.multiply.outer(centre_shift, np.conj(disk.pins.centre / np.abs(disk.pins.centre)))
    return _with_pins_moved(errors, travel)


def _with_pins_moved(errors: Errors, travel: Complex) -> Errors:
    """The errors with the pins moved too, outward and counterclockwise (n, n_pins) [mm]."""
    return replace(
        errors, pin_radial=errors.pin_radial + travel.real, pin_tangential=errors.pin_tangential + travel.imag
    )


def _closing(profile: CycloidProfile, disk: DiskPose, errors: Errors, method: str) -> Real:
    """What pins out of round take of their gaps (n, n_pins) [mm]; ``errors`` of the disk, the pins moved."""
    if method == "first_order":
        return first_order_closing(disk, errors.pin_roundness)
    displacements = errors.pin_radial, errors.pin_tangential, errors.eccentricity
    return exact_closing(profile, disk, displacements, errors.pin_roundness)


def pin_gaps(
    profile: CycloidProfile,
    disk: DiskPose,
    errors: Errors,
    *,
    method: str,
    disk_reading: str,
    motion: tuple[Complex, Real] | None = None,
) -> Real:
    """Gaps of the pins of one disk, (n, n_pins) [mm].

    Parameters
    ----------
    errors : of the disk.
    motion : finite motion of the disk from its nominal pose, translation (n,) complex [mm] and rotation (n,) [rad].

    Notes
    -----
    Seen from a disk that moves its pins move the other way: exact where ``method`` is.

    Without a motion a modification of the flank opens the gap to first order, whatever the method for errors: small
    motions keep normals and arms, and close gaps along them. Near a root the nearest point of a modified flank lies
    beside that normal: by distances the paper's flank, rotated by 1 arcmin, would play by 0.3 arcmin, not by 2.
    """
    if motion is None and method == "exact" and profile.modification != NOMINAL:
        generated = replace(profile, modification=NOMINAL)
        gap = pin_gaps(generated, disk, errors, method=method, disk_reading=disk_reading)
        return gap + modification_gaps(profile, disk)
    errors = _with_pins_turned(disk, errors)
    if motion is not None:
        translation, rotation = (values[:, None] for values in motion)
        radial = disk.pins.centre / np.abs(disk.pins.centre)
        pin = disk.pins.centre + radial * (errors.pin_radial + 1j * errors.pin_tangential)
        from_centre = pin - (disk.eccentricity + errors.eccentricity[:, None]) * np.exp(1j * disk.crank)
        travel = (from_centre - translation) * np.exp(-1j * rotation) - from_centre
        errors = _with_pins_moved(errors, travel * np.conj(radial))
    errors = _with_pins_off_centre(disk, errors)
    gap = {"exact": exact_gaps, "first_order": first_order_gaps}[method](profile, disk, errors, disk_reading)
    return gap - _closing(profile, disk, errors, method) if np.any(errors.pin_roundness) else gap


def gaps(
    profile: CycloidProfile, reducer: Reducer, errors: Errors, *, method: str, disk_reading: str, roller_reading: str
) -> Real:
    """Raw gap of every contact, (n, n_contacts) [mm].

    Parameters
    ----------
    method : ``"exact"`` or ``"first_order"``.
    disk_reading, roller_reading : keys of ``DISK_READINGS`` and ``ROLLER_READINGS``; the latter says nothing of
        contacts that are not two-sided, whose geometry leaves no choice.

    Raises
    ------
    ValueError
        If there is not one roller error for each contact of the output with a disk, and for each behind all disks.
    """
    rollers = len(reducer.output_rows[0]), reducer.n_behind
    if errors.roller_diameter.shape[1] != sum(rollers):
        raise ValueError(f"{errors.roller_diameter.shape[1]} roller errors for {sum(rollers)} rollers")
    of_rollers, of_behind = np.split(errors.roller_diameter, rollers[:1], axis=1)
    parts = []
    errors_of_disks = [errors.of_disk(number) for number in range(reducer.n_disks)]
    for disk, of_disk in zip(reducer.disks, errors_of_disks, strict=True):
        parts.append(pin_gaps(profile, disk, of_disk, method=method, disk_reading=disk_reading))
    groups = [(number, contacts, of_rollers) for number, contacts in enumerate(reducer.output_contacts)]
    if reducer.n_behind:
        groups.append((0, reducer.contacts.some(np.arange(-reducer.n_behind, 0)), of_behind))
    for number, contacts, diameters in groups:
        of_disk = replace(errors_of_disks[number], roller_diameter=diameters)
        gap = output_gaps(contacts, profile.eccentricity, of_disk, roller_reading)
        in_hole = np.flatnonzero(contacts.hole >= 0)
        if len(in_hole) and (np.any(of_disk.pin_off_hole) or np.any(of_disk.hole_diameter)):
            gap[:, in_hole] += hole_gaps(contacts.some(in_hole), reducer.disks[number], of_disk, method)
        parts.append(gap)
    gap = np.hstack(parts)
    if reducer.displacements and np.any(errors.displacement):
        matrix = np.hstack(list(reducer.displacements.values()))
        moved = np.flatnonzero(matrix.any(axis=1))
        travel = np.hstack([errors.displacement.real, errors.displacement.imag])
        gap[:, moved] += travel @ np.hstack([matrix.real, matrix.imag])[moved].T
    return gap
