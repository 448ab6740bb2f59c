"""Check of the flank: envelope of the pins, normals, curvature, arms, and two closed forms from the literature.

Check of the modified flank: exact gaps by a search, first order of the textbooks, the published take-up.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipeline import assembly
from pipeline.arrays import Complex, Real
from pipeline.checks.specimen import Finding, Specimen, largest_difference, relative, skipped_check, vanishing
from pipeline.config.designs.design import Design
from pipeline.model.geometry.clearance import Errors, exact_gaps, first_order_gaps
from pipeline.model.geometry.cycloid_profile import (
    NOMINAL,
    CycloidProfile,
    FlankModification,
    disk_rotation,
    pin_contacts,
)
from pipeline.model.geometry.rigid_play.rigid_backlash import separated_play

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
        distance: Real = np.abs(profile.flank(psi) - centre)
        return distance

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


def difference(function: Callable[..., Any], psi: Real) -> Complex:
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
    locus = profile.pin_circle_radius * np.exp(1j * phi)
    flank: Complex = locus - pin_offset - profile.eccentricity * np.exp(1j * n * phi)
    return flank


def _envelope(design: Design, profile: CycloidProfile) -> tuple[Real, Real]:
    """Distance of every nominal pin from the nominal flank [mm] at every crank angle: by search, and by the model."""
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
    profile = replace(specimen.profile, modification=NOMINAL)
    searched_points, model_points = _envelope(specimen.study.design, profile)
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


FLANK_CRANKS = 16
"""Crank angles of a turn at which distances are compared."""
ALONG, SHIFT, ROTATION = 8e-3, -3e-3, 2e-4
"""Equidistant and moved distance [mm] and rotation [rad]: each about 5 um on the paper's flank."""
AWAY_FROM_ROOTS = np.radians(40.0)


class TurnedFlank(CycloidProfile):
    """The flank of a rotation, each point as the textbooks write it; for ``flank_distance``."""

    def flank(self, psi: ArrayLike) -> Complex:
        k, phase = self.shortening, self.lobes * np.asarray(psi)
        s = np.sqrt(1 + k * k - 2 * k * np.cos(phase))
        arm = self.eccentricity * self.lobes * np.abs(np.sin(phase)) / s
        flank: Complex = self.locus(psi) + (self.pin_radius + ROTATION * arm) * self.normal(psi)
        return flank


def _gaps(specimen: Specimen, modification: FlankModification, crank: float) -> tuple[Real, Real, Real, Real]:
    """Phase, arm, exact and first-order gap of the nominal pins about the first disk."""
    profile, design = replace(specimen.profile, modification=modification), specimen.study.design
    disk = assembly.reducer(design, crank).disks[0]
    no_errors = Errors.zero(profile.pins, profile.lobes, design.output.contacts)
    exact, first_order = (method(profile, disk, no_errors, "radial")[0] for method in (exact_gaps, first_order_gaps))
    return disk.pins.phase, disk.pins.arm, exact, first_order


def _golden_section_gap(flank: CycloidProfile, profile: CycloidProfile, crank_deg: float) -> Real:
    """Gap of nominal pins by a golden-section search on another flank."""
    crank, theta = np.radians(crank_deg), profile.pin_angle()
    centre = profile.pin_circle_radius * np.exp(1j * theta) - profile.eccentricity * np.exp(1j * crank)
    turn = disk_rotation(profile, crank)
    return flank_distance(flank, centre * np.exp(-1j * turn), theta - turn) - profile.pin_radius


def _published_gap(profile: CycloidProfile, phase: Real, dr: float, circle: float) -> Real:
    """Gap after turning to the first contact.

    Source: Li, Guan and others, initial clearance of modified cycloid gears.
    """
    k, phi = profile.shortening, np.abs(phase)
    s, largest_sine = np.sqrt(1 + k * k - 2 * k * np.cos(phi)), np.sqrt(1 - k * k)
    gap: Real = dr * (1 - np.sin(phi) / s) - circle * (1 - k * np.cos(phi) - largest_sine * np.sin(phi)) / s
    return gap


def check_flank(specimen: Specimen) -> Iterator[Finding]:
    """Flank as drawn: equidistant, moved distance and rotation."""
    profile = specimen.profile
    cranks = np.degrees(2 * np.pi * (np.arange(FLANK_CRANKS) + 0.37) / FLANK_CRANKS)
    numbers = (profile.pins, profile.pin_circle_radius + SHIFT, profile.pin_radius + ALONG, profile.eccentricity)
    for name, modification, flank in (
        ("equidistant and moved distance", FlankModification(ALONG, SHIFT), CycloidProfile(*numbers)),
        ("rotation", FlankModification(rotation=ROTATION), TurnedFlank(*profile.numbers)),
    ):
        model_gaps = [_gaps(specimen, modification, crank)[2] for crank in cranks]
        searched_gaps = [_golden_section_gap(flank, profile, crank) for crank in cranks]
        yield largest_difference(
            f"gaps of the drawn flank against a search, {name} [mm]", searched_gaps, model_gaps, 1e-9
        )
    second_orders = []
    for size in (1.0, 0.1):
        every = FlankModification(size * ALONG, size * SHIFT, size * ROTATION)
        phase, _, exact, first_order = map(
            np.concatenate, zip(*(_gaps(specimen, every, c) for c in cranks), strict=True)
        )
        second_orders.append(np.abs(exact - first_order)[np.abs(phase) > AWAY_FROM_ROOTS].max())
    yield relative(
        "first order misses a hundredth at a tenth of the modification",
        100.0,
        second_orders[0] / second_orders[1],
        0.15,
    )
    yield from _taken_up(specimen)


def _taken_up(specimen: Specimen) -> Iterator[Finding]:
    profile = specimen.profile
    turning = []
    for crank in np.degrees(2 * np.pi / profile.pins * np.arange(FLANK_CRANKS * 8) / (FLANK_CRANKS * 8)):
        phase, arm, _, first_order = _gaps(specimen, FlankModification(ALONG, SHIFT), crank)
        turning.append(np.stack([phase, arm, first_order])[:, arm < 0])
    phase, arm, gap = np.concatenate(turning, axis=1)
    taken_up = gap + arm * np.min(gap / -arm)
    published_gap = _published_gap(profile, phase, ALONG, SHIFT)
    yield largest_difference(
        "gaps after turning to the first contact against Li and Guan [mm]", published_gap, taken_up, 2e-3 * ALONG
    )
    reducer = assembly.reducer(specimen.study.design, float(np.degrees(0.3)))
    if reducer.n_disks > 1 or not reducer.is_centred:
        yield skipped_check("play of a rotation does not apply: it is of one disk on an input bearing")
        return
    gap = np.zeros((1, len(reducer.contacts)))
    gap[0, : reducer.n_pins] = _gaps(specimen, FlankModification(rotation=ROTATION), float(np.degrees(0.3)))[3]
    yield relative(
        "play of a rotation is twice its angle [rad]", 2 * ROTATION, separated_play(reducer, gap).backlash[0], 1e-5
    )
