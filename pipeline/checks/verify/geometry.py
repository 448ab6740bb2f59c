"""Check of the flank: envelope of the pins, normals, curvature, arms, and two closed forms from the literature."""

from collections.abc import Iterator

import numpy as np

from pipeline import assembly
from pipeline.arrays import Complex, Real
from pipeline.checks.specimen import Specimen
from pipeline.checks.verify.findings import Finding, largest_difference, vanishing
from pipeline.model.geometry.clearance import Errors, exact_gaps
from pipeline.model.geometry.cycloid_profile import CycloidProfile, disk_rotation, pin_contacts

CRANKS = 64
"""Crank angles of a turn at which poses are compared."""
SCAN = 801
"""Points over three lobe pitches, between which the nearest one is refined."""
GOLDEN = (np.sqrt(5) - 1) / 2
"""Ratio of the golden-section search."""
NARROWINGS = 60
"""Golden-section steps: the bracket shrinks below the spacing of floating-point numbers."""
STEP = 2e-6
"""Of the flank parameter [rad] in the differences: truncation and rounding are both near 1e-11."""
STENCIL = {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}
"""Central first difference of fourth order."""


def flank_distance(profile: CycloidProfile, centre: Complex, start: Real) -> Real:
    """Distance of points ``centre`` (n,) from the flank by golden-section search about the parameters ``near`` (n,)."""

    def away(psi: Real) -> Real:
        return np.abs(profile.flank(psi) - centre)

    spacing = 3 * profile.lobe_pitch / (SCAN - 1)
    offsets = spacing * (np.arange(SCAN) - SCAN // 2)
    scan = np.abs(profile.flank(start[:, None] + offsets) - centre[:, None])
    nearest_phase = start + offsets[np.argmin(scan, axis=1)]
    low, high = nearest_phase - spacing, nearest_phase + spacing
    for _ in range(NARROWINGS):
        lower, upper = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        falls = away(lower) > away(upper)
        low, high = np.where(falls, lower, low), np.where(falls, high, upper)
    return away(0.5 * (low + high))


def difference(function, psi: Real) -> Complex:
    """Numerical derivative of a function of the flank parameter."""
    total: Complex = sum(weight * function(psi + k * STEP) for k, weight in STENCIL.items())
    return total / STEP


def li_guan_flank(profile: CycloidProfile, phi: Real) -> Complex:
    """Flank of Li, He, Guan: parameter phi is the turning angle of the crank against the lobe's root.

    Source: Lixing Li, Weidong He, Tianmin Guan, equations of the tooth profile of cycloid drives, i = N/(N-1).
    """
    ratio = profile.pins / profile.lobes
    k = profile.shortening
    width = profile.pin_radius / np.sqrt(1 + k * k - 2 * k * np.cos(phi))
    outer, inner = profile.pin_circle_radius - width, profile.eccentricity - k * width
    x = outer * np.cos((1 - ratio) * phi) - inner * np.cos(ratio * phi)
    y = outer * np.sin((1 - ratio) * phi) + inner * np.sin(ratio * phi)
    return x + 1j * y


def blanche_yang_flank(profile: CycloidProfile, phi: Real) -> Complex:
    """Flank with the angle psi between pin radius and normal (Blanche and Yang 1989), with the signs that envelop."""
    n = profile.pins
    psi = np.arctan2(np.sin((1 - n) * phi), 1 / profile.shortening - np.cos((1 - n) * phi))
    pin_offset = profile.pin_radius * np.exp(1j * (phi + psi))
    return profile.pin_circle_radius * np.exp(1j * phi) - pin_offset - profile.eccentricity * np.exp(1j * n * phi)


def _envelope(specimen: Specimen) -> tuple[Real, Real]:
    """Distance of every nominal pin from the nominal flank [mm] at every crank angle: by search, and by the model."""
    profile, design = specimen.profile, specimen.study.design
    no_errors = Errors.zero(profile.pins, profile.lobes, design.output.contacts)
    searched_points, model_points = [], []
    for crank in np.degrees(2 * np.pi * np.arange(CRANKS) / CRANKS):
        reducer = assembly.reducer(design, crank)
        centre = (reducer.pins.centre - profile.eccentricity * np.exp(1j * reducer.crank)) * np.exp(
            -1j * disk_rotation(profile, reducer.crank)
        )
        searched_points.append(flank_distance(profile, centre, reducer.pins.flank_parameter) - profile.pin_radius)
        model_points.append(exact_gaps(profile, reducer, no_errors, "radial")[0])
    return np.array(searched_points), np.array(model_points)


def _arms(profile: CycloidProfile) -> tuple[Real, Real]:
    """Arms of the model, and e (N-1) sin(beta)/S of the textbooks, at every crank angle."""
    arms, closed_forms = [], []
    k = profile.shortening
    for crank in 2 * np.pi * np.arange(CRANKS) / CRANKS:
        beta = profile.pin_angle() - crank
        arms.append(pin_contacts(profile, crank).arm)
        closed_forms.append(
            -profile.eccentricity * profile.lobes * np.sin(beta) / np.sqrt(1 + k * k - 2 * k * np.cos(beta))
        )
    return np.array(arms), np.array(closed_forms)


def check_profile(specimen: Specimen) -> Iterator[Finding]:
    """Profile, normals, curvature, arms."""
    profile = specimen.profile
    searched_points, model_points = _envelope(specimen)
    yield vanishing("distance of nominal pins from the flank, 64 crank angles [mm]", searched_points, 1e-9)
    yield vanishing("gaps of the nominal reducer, 64 crank angles [mm]", model_points, 1e-9)
    psi = 2 * np.pi * ((np.arange(4000) + 0.3) / 4000 - 0.5)
    slope = difference(profile.flank, psi)
    yield vanishing(
        "normal against the differentiated flank [rad]",
        np.angle(1j * slope / np.abs(slope) / profile.normal(psi)),
        1e-8,
    )
    turning = np.imag(difference(profile.normal, psi) / profile.normal(psi)) / np.abs(slope)
    yield largest_difference(
        "curvature against the differentiated normal, times the pin radius [-]",
        turning * profile.pin_radius,
        profile.flank_curvature(profile.phase(psi)) * profile.pin_radius,
        1e-8,
    )
    yield vanishing(
        "flank against Li, He, Guan [mm]",
        np.abs(profile.flank(psi) - li_guan_flank(profile, -profile.lobes * psi)),
        1e-12,
    )
    yield vanishing(
        "flank against Blanche and Yang [mm]", np.abs(profile.flank(psi) - blanche_yang_flank(profile, psi)), 1e-12
    )
    arms, closed_forms = _arms(profile)
    yield largest_difference("arm against e (N-1) sin(beta)/S [mm]", closed_forms, arms, 1e-12)
    beta = np.linspace(0, np.pi, 200_001)
    k = profile.shortening
    arm_at_all = profile.eccentricity * profile.lobes * np.sin(beta) / np.sqrt(1 + k * k - 2 * k * np.cos(beta))
    yield largest_difference(
        "largest arm against e (N-1) [mm]", profile.eccentricity * profile.lobes, arm_at_all.max(), 1e-8
    )
