"""Check of the share of the pins on equal linear springs, against the closed form of the textbooks.

Check against a published load on a modified disk: by its authors' assumptions, then ours one after the other.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import assembly, elastic
from pipeline.arrays import Real
from pipeline.checks.specimen import Finding, Specimen, largest_difference, relative, reported_number, vanishing
from pipeline.config import Study, load_study
from pipeline.model.equilibrium.solve import ElasticReducer, solve
from pipeline.model.geometry.clearance import Errors, gaps
from pipeline.model.geometry.reducer import Bearing, Reducer
from pipeline.model.geometry.rigid_play.rigid_backlash import rigid_play
from pipeline.model.units import NMM_PER_NM
from pipeline.settings import PROJECT

STIFFNESS, BEARING = 10.0, 1e12
"""Of a contact and of the bearing [N/mm]: together they hold the disk's centre to 1e-10 of a deflection."""
CRANKS_DEG = (0.0, 1.3, 200.0)
"""Crank angles [deg]: a pin on the line of the eccentric, off it, and far away."""
SHARE = 1e-4
"""Of the rated torque."""


def textbook_forces(specimen: Specimen, reducer: Reducer, torque: float) -> Real:
    """F_max sin(phi)/S of the pins of the loaded half, F_max = T/(e Z sum of sin^2/S^2).

    Source: the classic share of cycloid drives; its sum tends to N/4, so that F_max tends to 4 T/(e Z N).
    """
    profile = specimen.profile
    k, phi = profile.shortening, profile.pin_angle() - reducer.crank
    arm = np.sin(phi) / np.sqrt(1 + k * k - 2 * k * np.cos(phi))
    loaded_arm: Real = np.maximum(arm, 0.0)
    return torque / (profile.eccentricity * profile.lobes * np.sum(loaded_arm**2)) * loaded_arm


def check_linear_share(specimen: Specimen) -> Iterator[Finding]:
    """Linear springs: rigid disk, no gaps, equal springs, stiff bearing: forces as the arms of the loaded pins."""
    torque = SHARE * NMM_PER_NM * specimen.study.design.cycloid.rated_torque_Nm
    linear = specimen.study.springs.model_copy(update={"law": "linear", "stiffness_N_per_mm": STIFFNESS})
    rigid = specimen.study.reduce.model_copy(update={"disk": "rigid"})
    study = specimen.study.model_copy(update={"springs": linear, "reduce": rigid})
    pin_forces, textbook, moment, displacement = [], [], [], []
    for crank in CRANKS_DEG:
        reducer = assembly.reducer(study.design, crank)
        n = len(reducer.contacts)
        no_gaps, start = np.zeros((1, n)), np.zeros((1, len(reducer.motions)))
        laws = assembly.contact_laws(study, reducer)
        elastic = ElasticReducer(reducer, Bearing(BEARING, 1.0), laws, np.zeros((n, n)))
        states = solve(elastic, no_gaps, np.zeros(1), start, np.array([torque]))
        pin_forces.append(states.force[0, 0, : reducer.n_pins])
        textbook.append(textbook_forces(specimen, reducer, torque))
        moment.append(abs(pin_forces[-1] @ reducer.pins.arm))
        displacement.append(states.motion[0, 0, :2] * STIFFNESS / np.max(pin_forces[-1]))
    limit = 4 * torque / (specimen.profile.eccentricity * specimen.profile.lobes * specimen.profile.pins)
    largest_force = np.max(textbook)
    yield relative(
        "pin forces of equal linear springs, with the largest added",
        largest_force + np.array(textbook),
        largest_force + np.array(pin_forces),
        1e-9,
    )
    yield relative("largest of these springs against 4 T/(e Z N)", limit, np.max(pin_forces), 0.05)
    yield relative("moment of these forces about the disk's centre against the torque [N mm]", torque, moment, 1e-9)
    yield vanishing("shift of the disk over the deflection of a spring", displacement, 1e-9)


STUDY, FORCES = "li_guan", Path("data") / "published" / "li_guan_forces.csv"
LIMIT = 5e-4
"""Of the largest force: the published ones are rounded to 0.1 N."""
VARIANTS = (
    ("Hertz on a solid disk for their linear law", {"springs": {"law": "hertz", "stiffness_N_per_mm": None}}),
    ("an elastic disk for their rigid one", {"reduce": {"disk": "elastic"}}),
)
"""Our assumptions for those of the authors, each on top of those before."""


def check_li_guan(specimen: Specimen) -> Iterator[Finding]:
    """Li and Guan's six forces: two numbers of their flank are fitted to them; then our assumptions, one by one."""
    study = load_study(STUDY, PROJECT)
    table = pd.read_csv(PROJECT / FORCES)
    phase, published_force = table["phase_deg"].to_numpy(float), table["force_N"].to_numpy(float)
    arm = study.design.cycloid.eccentricity_mm * study.design.cycloid.lobes * arm_share(study, phase)
    torque = NMM_PER_NM * study.design.cycloid.rated_torque_Nm
    yield relative("moment of the published forces against 0.55 of 25.785 N m", torque, published_force @ arm, 2e-4)
    force = pin_forces(study, phase)
    yield largest_difference(
        "the six forces, rigid disk, linear law, fitted flank, over the largest [N]",
        published_force,
        force,
        LIMIT,
        published_force.max(),
    )
    yield from _against(phase, published_force, force, "by the authors' assumptions")
    for name, changes in VARIANTS:
        sections = {key: getattr(study, key).model_copy(update=update) for key, update in changes.items()}
        study = study.model_copy(update=sections)
        yield from _against(phase, published_force, pin_forces(study, phase), name)


def _against(phase: Real, published_force: Real, force: Real, name: str) -> Iterator[Finding]:
    for angle, reference, value in zip(phase, published_force, force, strict=True):
        yield reported_number(f"force at {angle:g} degrees, {name} [N]", float(value), float(reference))


def arm_share(study: Study, phase_deg: Real) -> Real:
    """sin(phi)/S of phases [deg]: the arm over the largest."""
    cycloid, phi = study.design.cycloid, np.radians(phase_deg)
    k = cycloid.eccentricity_mm * cycloid.pins / cycloid.pin_circle_radius_mm
    return np.sin(phi) / np.sqrt(1 + k * k - 2 * k * np.cos(phi))


def pin_forces(study: Study, phase_deg: Real, crank_deg: float = 0.0) -> Real:
    """Forces (n,) [N] of the nominal pins at the phases [deg], in the sense of torque that loads them."""
    reducer, profile = assembly.reducer(study.design, crank_deg), assembly.profile(study.design)
    n = reducer.n_pins
    nominal = Errors.zero(n, profile.lobes, len(reducer.contacts) - n)
    gap, no_clearance = gaps(profile, reducer, nominal, **dict(study.clearance)), np.zeros(1)
    compliance = np.zeros((len(reducer.contacts), len(reducer.contacts)))
    if study.reduce.disk == "elastic":
        disk = elastic.elastic_disk(study)
        compliance = disk.compliance(elastic.disk_patches(study, disk, reducer)).matrix
    laws, torque = assembly.contact_laws(study, reducer), NMM_PER_NM * study.design.cycloid.rated_torque_Nm
    play = rigid_play(reducer, gap, no_clearance)
    elastic_reducer = ElasticReducer(reducer, assembly.bearing(study.design), laws, compliance)
    states = solve(elastic_reducer, gap, no_clearance, play.pose_plus, np.array([torque]))
    pin_force = states.force[0, 0, :n]
    sense = np.sign(reducer.pins.phase[np.argmax(pin_force)])
    pin_numbers = [int(np.argmin(np.abs(reducer.pins.phase - sense * np.radians(angle)))) for angle in phase_deg]
    return pin_force[pin_numbers]
