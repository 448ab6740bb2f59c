"""Effects on elasticity against closed forms: seats, torsion, cubic spring, modulus."""

from dataclasses import replace

import numpy as np
import pytest
from drives import RATED, small_drive
from drives_with_effects import SHARES, put
from reducers import ARCMIN

from pipeline.model.effects import Conditions
from pipeline.model.elements import Path
from pipeline.model.load_history.backbone import backbone


def test_seat_adds_its_deflection_to_every_pin():
    drive, force = small_drive(), 37.0
    soft, n = put(drive, "seat_compliance", 0.25), drive.reducer.n_pins
    every = np.full(len(drive.laws), force)
    increment = soft.laws.deflection(every) - drive.laws.deflection(every)
    np.testing.assert_allclose(increment[:n], 0.25e-3 * force, rtol=1e-12)
    np.testing.assert_array_equal(increment[n:], 0.0)
    force_beyond = 2 * drive.laws.force_limit  # on the tangent too
    increment = soft.laws.deflection(force_beyond) - drive.laws.deflection(force_beyond)
    np.testing.assert_allclose(increment[:n], 0.25e-3 * force_beyond[:n], rtol=1e-9)


def test_torsion_of_the_output_is_exact():
    drive = small_drive()
    variant = backbone(put(drive, "output_torsion", 0.04), SHARES)
    reference = backbone(drive, SHARES)
    np.testing.assert_allclose(
        ARCMIN * (variant.angle - reference.angle)[0], 0.04 * 1e-3 * reference.torque, atol=1e-12
    )


@pytest.mark.parametrize("order", [1, 2])
def test_compliance_that_varies_with_the_crank_has_its_size_and_phase(order):
    """Twist of a perfect spring of 1 + cos over the crank, in proportion to the torque in both senses."""
    size, phase = 0.05, 0.7
    waves = size * np.cos(phase), size * np.sin(phase)
    for crank in np.linspace(0.0, 2 * np.pi, 5, endpoint=False):
        drive = small_drive(crank=crank)
        variant = backbone(put(drive, f"crank_compliance_{order}", *waves), SHARES)
        reference = backbone(drive, SHARES)
        compliance = 1e-3 * size * (1 + np.cos(order * crank - phase))
        difference = ARCMIN * (variant.angle - reference.angle)[0]
        np.testing.assert_allclose(difference, compliance * reference.torque, atol=1e-12)


def test_softening_compliance_is_a_cubic_spring():
    drive, knee = small_drive(), 0.3 * RATED
    spring = put(drive, "softening_compliance", 0.04, 1e-3 * knee)
    torque = np.linspace(-RATED, RATED, 41)
    twist = spring.twist(torque)
    linear = 0.04e-3 / ARCMIN * knee  # twist at which the linear part carries the knee
    np.testing.assert_allclose(twist / linear + (twist / linear) ** 3, torque / knee, atol=1e-12)
    at_no_load = np.array([-1e-6, 1e-6]) * RATED
    np.testing.assert_allclose(spring.twist(at_no_load), 0.04e-3 / ARCMIN * at_no_load, rtol=1e-9)
    assert spring.twist(np.array([2 * knee])) == pytest.approx(linear)
    variant, reference = backbone(spring, SHARES), backbone(drive, SHARES)
    np.testing.assert_allclose((variant.angle - reference.angle)[0], spring.twist(reference.torque), atol=1e-15)
    np.testing.assert_array_equal(spring.without_elements.twist(torque), 0.0)


def test_softening_compliance_of_a_far_knee_is_the_torsion_of_the_output():
    drive, torque = small_drive(), np.linspace(-RATED, RATED, 9)
    soft, linear = put(drive, "softening_compliance", 0.04, 1e-3 * 1e4 * RATED), put(drive, "output_torsion", 0.04)
    np.testing.assert_allclose(soft.twist(torque), linear.twist(torque), rtol=1e-7)


def test_a_softer_modulus_is_that_of_the_parts():
    """The curve with compliance and contact laws of the softer material, solved anew, at the same torques."""
    drive, loss, warm = small_drive(), 0.01, 30.0
    variant = put(drive, "modulus_temperature", loss, conditions=Conditions(np.zeros(1), np.array([warm])))
    factor = variant.stiffening(0)
    assert factor == pytest.approx(1 - loss * warm)
    laws = drive.laws
    soft = replace(
        laws,
        linear=laws.linear / factor + laws.logarithmic * np.log(factor) / factor,
        logarithmic=laws.logarithmic / factor,
        power=laws.power / factor**laws.exponent,
    )
    bearing = replace(drive.bearing, stiffness=drive.bearing.stiffness * factor)
    parts = replace(drive, laws=soft, compliance=drive.compliance / factor, bearing=bearing)
    model_value, reference_value = backbone(drive, SHARES), backbone(parts, factor * SHARES)
    np.testing.assert_allclose(reference_value.angle, model_value.angle, rtol=1e-6, atol=1e-9)


def test_creep_comes_to_its_compliance_times_the_torque():
    (element,) = put(small_drive(), "creep", 0.04, 20.0).hystereses
    torque = np.full(3, 5e3)
    twist = element.twist(Path(torque, np.array([0.0, 20.0, 1e4])))
    share = np.array([0.0, 1 - np.exp(-1), 1.0])
    np.testing.assert_allclose(ARCMIN * (twist - twist[0]), 0.04 * 5.0 * share, rtol=1e-6)
