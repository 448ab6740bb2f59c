"""Check of the modified flank: exact gaps by a search, first order of the textbooks, the published take-up."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pipeline import assembly
from pipeline.arrays import Real
from pipeline.checks.specimen import Specimen
from pipeline.checks.verify.findings import Finding, largest_difference, relative
from pipeline.checks.verify.geometry import flank_distance
from pipeline.model.geometry.clearance import Errors, exact_gaps, first_order_gaps
from pipeline.model.geometry.cycloid_profile import CycloidProfile, FlankModification, disk_rotation
from pipeline.model.geometry.rigid_play.rigid_backlash import separated_play

CRANKS = 16
"""Crank angles of a turn at which distances are compared."""
ALONG, SHIFT, ROTATION = 8e-3, -3e-3, 2e-4
"""Equidistant and moved distance [mm] and rotation [rad]: each about 5 um on the paper's flank."""
AWAY_FROM_ROOTS = np.radians(40.0)


class TurnedFlank(CycloidProfile):
    """The flank of a rotation, each point as the textbooks write it; for ``flank_distance``."""

    def flank(self, psi):
        k, phase = self.shortening, self.lobes * np.asarray(psi)
        s = np.sqrt(1 + k * k - 2 * k * np.cos(phase))
        arm = self.eccentricity * self.lobes * np.abs(np.sin(phase)) / s
        return self.locus(psi) + (self.pin_radius + ROTATION * arm) * self.normal(psi)


def _gaps(specimen: Specimen, modification: FlankModification, crank: float) -> tuple[Real, Real, Real, Real]:
    """Phase, arm, exact and first-order gap of the nominal pins."""
    profile, reducer = (
        replace(specimen.profile, modification=modification),
        assembly.reducer(specimen.study.design, crank),
    )
    no_errors = Errors.zero(profile.pins, profile.lobes, len(reducer.contacts) - reducer.n_pins)
    exact, first_order = (method(profile, reducer, no_errors, "radial")[0] for method in (exact_gaps, first_order_gaps))
    return reducer.pins.phase, reducer.pins.arm, exact, first_order


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
    return dr * (1 - np.sin(phi) / s) - circle * (1 - k * np.cos(phi) - largest_sine * np.sin(phi)) / s


def check_flank(specimen: Specimen) -> Iterator[Finding]:
    """Flank as drawn: equidistant, moved distance and rotation."""
    profile = specimen.profile
    cranks = np.degrees(2 * np.pi * (np.arange(CRANKS) + 0.37) / CRANKS)
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
    for crank in np.degrees(2 * np.pi / profile.pins * np.arange(CRANKS * 8) / (CRANKS * 8)):
        phase, arm, _, first_order = _gaps(specimen, FlankModification(ALONG, SHIFT), crank)
        turning.append(np.stack([phase, arm, first_order])[:, arm < 0])
    phase, arm, gap = np.concatenate(turning, axis=1)
    taken_up = gap + arm * np.min(gap / -arm)
    published_gap = _published_gap(profile, phase, ALONG, SHIFT)
    yield largest_difference(
        "gaps after turning to the first contact against Li and Guan [mm]", published_gap, taken_up, 2e-3 * ALONG
    )
    reducer = assembly.reducer(specimen.study.design, float(np.degrees(0.3)))
    gap = np.zeros((1, len(reducer.contacts)))
    gap[0, : reducer.n_pins] = _gaps(specimen, FlankModification(rotation=ROTATION), float(np.degrees(0.3)))[3]
    yield relative(
        "play of a rotation is twice its angle [rad]", 2 * ROTATION, separated_play(reducer, gap).backlash[0], 1e-5
    )
