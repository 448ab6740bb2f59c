"""Check of the share of the pins on equal linear springs, against the closed form of the textbooks."""

from collections.abc import Iterator

import numpy as np

from pipeline import assembly
from pipeline.arrays import Real
from pipeline.checks.specimen import Specimen
from pipeline.checks.verify.findings import Finding, relative, vanishing
from pipeline.model.equilibrium.solve import ElasticReducer, solve
from pipeline.model.geometry.reducer import Bearing, Reducer
from pipeline.model.units import NMM_PER_NM

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
    loaded_arm = np.maximum(arm, 0.0)
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
