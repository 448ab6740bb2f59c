"""Two reducers for the tests, the paper's and a small one, with errors, laws and a compliance for them."""

import numpy as np

from pipeline.config.mechanisms.pin_in_hole import PinInHole
from pipeline.config.mechanisms.roller_plate import RollerPlate
from pipeline.model.contact.laws import (
    LineContact,
    Material,
    concatenated_laws,
    cylinder_share,
    flat_share,
    mesh_compliance,
    meshed_share,
)
from pipeline.model.contact.line_laws.hertz import hertz_laws
from pipeline.model.contact.line_laws.palmgren import palmgren_laws
from pipeline.model.geometry.clearance import Errors
from pipeline.model.geometry.contacts import OUTPUT
from pipeline.model.geometry.cycloid_profile import CycloidProfile
from pipeline.model.geometry.reducer import nominal_reducer

PAPER = CycloidProfile(pins=80, pin_circle_radius=32.5, pin_radius=0.8, eccentricity=0.35)
SMALL = CycloidProfile(pins=12, pin_circle_radius=10.0, pin_radius=1.0, eccentricity=0.55)
STEEL = Material(206e3, 0.3, "plane_stress")
ARCMIN = 180 * 60 / np.pi
MICROMETRE = 1e-3


def pins_in_holes(profile, pins, clearance=0.0, phase_deg=0.0):
    """Output pins of steel with a clearance [mm] in their holes, of a size that the profile's disk has room for."""
    radius, circle = (3.0, 20.0) if profile is PAPER else (0.6, 5.0)
    return PinInHole(
        mechanism="pin_in_hole",
        pins=pins,
        pin_radius_mm=radius,
        pin_circle_radius_mm=circle,
        pin_material="steel",
        hole_clearance_um=clearance / MICROMETRE,
        phase_deg=phase_deg,
    )


def profile_with(pins, shortening, pin_share, chord_share):
    """A profile on a circle of 50 mm whose pins leave the flank convex and room between themselves."""
    eccentricity = shortening * 50.0 / pins
    convex = CycloidProfile(pins, 50.0, 0.0, eccentricity).smallest_convex_locus_radius()
    return CycloidProfile(pins, 50.0, min(pin_share * convex, chord_share * np.pi * 50.0 / pins), eccentricity)


def reducer_at(profile, crank, *, floats=False, slide_angle=0.5 * np.pi):
    stations, outer, inner, offset = (3, 18.65, 4.6, 5.0) if profile is PAPER else (2, 4.5, 3.0, 2.0)
    plate = RollerPlate(
        mechanism="roller_plate",
        roller_radius_mm=1.5,
        rollers=8 * stations,
        roller_length_mm=2.0,
        roller_material="steel",
        inner_station_mm=inner,
        outer_station_mm=outer,
        face_offset_mm=offset,
        slide_angle_deg=float(np.degrees(slide_angle)),
        plate="floats" if floats else "rotates",
        flat_depth_mm=5.0,
        plate_material="steel",
    )
    return nominal_reducer(profile, plate, crank)


def errors_of(profile, reducer, n=1, **arguments):
    """Zero errors but for those ``arguments`` [mm]: scalars or arrays."""
    zero = Errors.zero(profile.pins, profile.lobes, np.count_nonzero(reducer.contacts.kind == OUTPUT), n)
    shapes = {
        name: np.broadcast_shapes(value.shape, np.shape(arguments.get(name, 0.0))) for name, value in vars(zero).items()
    }
    return Errors(**{name: np.zeros(shapes[name]) + arguments.get(name, 0.0) for name in shapes})


def random_errors(profile, reducer, n, scale, rng, lobe_scale=None):
    zero = errors_of(profile, reducer, n)
    drawn_errors = {name: scale * rng.uniform(-1, 1, value.shape) for name, value in vars(zero).items()}
    drawn_errors["eccentric_phase"][:] = 0.0  # of one disk it only turns the crank
    for name in ("lobe_pitch", "bore_runout", "hole_diameter", "pin_off_hole", "pin_roundness"):
        drawn_errors[name][:] = 0.0  # each has tests of its own
    if lobe_scale is not None:
        drawn_errors["lobe"] *= lobe_scale / scale
    return Errors(**drawn_errors)


def laws_of(profile, reducer, law="hertz", width=0.15, length=2.0):
    """Laws of every contact: pins on a meshed flank, rollers between two flats."""
    radius = profile.pin_radius
    pins = LineContact(1 / (1 / radius + reducer.pins.flank_curvature), length, STEEL, STEEL)
    rollers = LineContact(np.full(len(reducer.contacts) - profile.pins, 1.5), length, STEEL, STEEL)
    if law == "palmgren":
        mesh_part = mesh_compliance(STEEL, length, radius, width)
        return concatenated_laws([palmgren_laws(pins, 1, mesh_part), palmgren_laws(rollers, 2, 0.0)])
    halves = [cylinder_share(rollers, STEEL, 1.5), flat_share(rollers, STEEL, 5.0)]
    return concatenated_laws(
        [
            hertz_laws(pins, [cylinder_share(pins, STEEL, radius), meshed_share(pins, STEEL, width)], radius),
            hertz_laws(rollers, [*halves, *halves], 1.5),
        ]
    )


def random_compliance(n, rng, size=3e-6):
    """Symmetric positive definite (n, n) [mm/N], with couplings of either sign."""
    factor = rng.normal(size=(n, n))
    return size * (factor @ factor.T / n + 0.5 * np.eye(n))


def equal_disks(reducer, seed=7):
    """A compliance (n_contacts, n_contacts) [mm/N] of disks that are one part, each in its place of the turn."""
    rng, full = np.random.default_rng(seed), np.zeros((len(reducer.contacts), len(reducer.contacts)))
    pins, holes = reducer.n_pins // reducer.n_disks, int(reducer.contacts.station.max()) + 1
    block = random_compliance(pins + holes, rng)
    for disk in range(reducer.n_disks):
        rows = np.flatnonzero(reducer.disk_of_contact == disk)
        numbers = [np.roll(kind, disk * len(kind) // reducer.n_disks) for kind in (rows[:pins], rows[pins:])]
        order = np.concatenate(numbers)  # numbers run clockwise, eccentrics counterclockwise
        full[np.ix_(order, order)] = block
    return full


def laws_of_disks(profile, reducer):
    """Laws of every contact: pins and output pins on the walls of a meshed disk."""
    n_out = len(reducer.contacts) - reducer.n_pins
    on_flank = LineContact(1 / (1 / profile.pin_radius + reducer.pins.flank_curvature), 2.0, STEEL, STEEL)
    in_hole = LineContact(np.full(n_out, 1.5), 2.0, STEEL, STEEL)
    shares = [[cylinder_share(line, STEEL, 1.0), meshed_share(line, STEEL, 0.15)] for line in (on_flank, in_hole)]
    return concatenated_laws([hertz_laws(on_flank, shares[0], 1.0), hertz_laws(in_hole, shares[1], 1.0)])
