"""Every effect of the library: texts, bounds, and what it does to a drive, by closed forms and other programs."""

from dataclasses import replace

import numpy as np
import pytest
from drives import RATED, small_drive
from reducers import ARCMIN, MICROMETRE, PAPER, SMALL

from pipeline.identification.bench.instrument_effects import instrument_effects
from pipeline.model.effects import Conditions, library
from pipeline.model.effects.effect import CRANKS, CYCLES, RATE, STILL, TEMPERATURE, TIME
from pipeline.model.geometry.clearance import gaps
from pipeline.model.geometry.rigid_backlash import general_play, separated_play
from pipeline.model.load_history.backbone import backbone, torque_levels
from pipeline.model.load_history.friction.output_path import Ripple, output_path
from pipeline.model.load_history.rayleigh import rayleigh_twist

LIBRARY = library()
EVERY = pytest.mark.parametrize("name", LIBRARY)
ALL_NAMES = {**LIBRARY, **instrument_effects()}
UNITS = {
    "um": "um",
    "N m": "Nm",
    "arcmin": "arcmin",
    "um/N": "um_per_N",
    "arcmin/(N m)": "arcmin_per_Nm",
    "s": "s",
    "um/(m K)": "um_per_m_K",
    "arcmin/h": "arcmin_per_h",
    "arcmin/(N m)2": "arcmin_per_Nm2",
    "1/K": "per_K",
}
SHARES = torque_levels(20, 1.05)
MIDDLE = len(SHARES)


def put(drive, name, *values, conditions=None):
    """The drive with an effect of the library."""
    return LIBRARY[name].apply(drive, values, conditions or Conditions.run_in(len(drive.gap)))


@pytest.mark.parametrize("name", ALL_NAMES)
def test_texts_are_complete_and_names_are_known(name):
    effect = ALL_NAMES[name]
    assert effect.name == name
    for text in (effect.title, effect.physics, effect.source, effect.changes, effect.signature, effect.told_apart_by):
        assert len(text) > 5
        assert text == text.strip()
    assert 1 <= len(effect.parameters) <= 3
    for parameter in effect.parameters:
        assert parameter.meaning
        if parameter.unit != "1":
            assert parameter.name.endswith("_" + UNITS[parameter.unit])
    assert len({parameter.name for parameter in effect.parameters}) == len(effect.parameters)
    assert set(effect.confused_with) <= set(ALL_NAMES) - {name}
    assert effect.limit_case in {"", *ALL_NAMES}
    assert effect.starts in ("secants", "periods")
    assert effect.needs <= {CRANKS, CYCLES, TIME, TEMPERATURE, STILL, RATE}


@EVERY
def test_bounds_are_finite_and_ordered(name):
    pairs = LIBRARY[name].bounds(small_drive())
    assert len(pairs) == len(LIBRARY[name].parameters)
    assert np.all(np.isfinite(pairs))
    assert all(low < high for low, high in pairs)


@pytest.mark.parametrize("profile", [SMALL, PAPER], ids=["small", "paper"])
@pytest.mark.parametrize("name", ["output_torsion", "creep", "softening_compliance"])
def test_bounds_of_a_twist_hold_the_drives_own_and_little_more(name, profile):
    drive = small_drive(scale=0.0, play=0.0, profile=profile)
    curve = backbone(drive, SHARES)
    twist_of_drive = 1e3 * ARCMIN * np.ptp(curve.angle[0, MIDDLE:]) / np.ptp(curve.torque[MIDDLE:])  # [arcmin/(N m)]
    _, high = LIBRARY[name].bounds(drive)[0]
    assert 2 * twist_of_drive < high < 100 * twist_of_drive


@EVERY
def test_nothing_is_changed_by_an_effect_of_size_zero(name):
    drive, effect = small_drive(2), LIBRARY[name]
    pairs = effect.bounds(drive)
    assert any(low <= 0 <= high for low, high in pairs)
    values = [0.0 if low <= 0 <= high else (low * high) ** 0.5 for low, high in pairs]
    conditions = Conditions(np.array([0.0, 3.0]), np.array([0.0, 15.0]))
    variant = put(drive, name, *values, conditions=conditions)
    np.testing.assert_allclose(variant.gap, drive.gap, atol=1e-15)
    np.testing.assert_array_equal(variant.bearing_clearance, drive.bearing_clearance)
    np.testing.assert_array_equal(variant.laws.linear, drive.laws.linear)
    assert variant.torsion == drive.torsion
    assert len(variant.sliders.acting) == 0
    assert variant.creep is None or variant.creep.compliance == 0
    np.testing.assert_array_equal(variant.twist(np.array([-1e3, 1e3])), drive.twist(np.array([-1e3, 1e3])))


@EVERY
def test_an_effect_leaves_the_drive_that_it_is_put_into_as_it_was(name):
    drive, effect = small_drive(2), LIBRARY[name]
    arrays_before = {key: np.copy(value) for key, value in vars(drive).items() if isinstance(value, np.ndarray)}
    linear, gap = drive.laws.linear.copy(), drive.gap.copy()
    values = [low + 0.7 * (high - low) for low, high in effect.bounds(drive)]
    variant = put(drive, name, *values, conditions=Conditions(np.array([0.0, 3.0]), np.array([0.0, 15.0])))
    for key, value in arrays_before.items():
        np.testing.assert_array_equal(getattr(drive, key), value)
    np.testing.assert_array_equal(drive.laws.linear, linear)
    np.testing.assert_array_equal(drive.gap, gap)
    assert variant is not drive


@EVERY
def test_effects_add_up_where_they_are_put_in_twice(name):
    if name in ("creep", "softening_compliance"):
        pytest.skip("one such element only")
    drive, effect = small_drive(1), LIBRARY[name]
    values = [low + 0.6 * (high - low) for low, high in effect.bounds(drive)]
    conditions = Conditions(np.array([3.0]), np.array([15.0]))
    single_change = put(drive, name, *values, conditions=conditions)
    double_change = put(single_change, name, *values, conditions=conditions)
    if len(single_change.sliders):
        assert len(double_change.sliders) == 2 * len(single_change.sliders)
    np.testing.assert_allclose(double_change.torsion - single_change.torsion, single_change.torsion - drive.torsion)
    np.testing.assert_allclose(
        double_change.laws.linear - single_change.laws.linear, single_change.laws.linear - drive.laws.linear
    )
    np.testing.assert_allclose(double_change.shift - single_change.shift, single_change.shift - drive.shift, atol=1e-15)
    for key, value in vars(double_change.errors).items():
        error_of_one = getattr(single_change.errors, key)
        np.testing.assert_allclose(value - error_of_one, error_of_one - getattr(drive.errors, key), atol=1e-15)


# --- physics of each ------------------------------------------------------------------------------------------------


def ends(drive):
    """Poses of the output at the ends of the rigid play (n,), minus and plus."""
    play = separated_play(drive.reducer, drive.gap)
    output = drive.reducer.output_motion
    return play.pose_minus[:, output], play.pose_plus[:, output]


@pytest.mark.parametrize("depth_um", [5.0, -5.0])
def test_flank_wear_moves_one_end_of_the_play(depth_um):
    drive = small_drive(4, scale=1 * MICROMETRE)
    worn = put(drive, "flank_wear", depth_um)
    (minus, plus), (worn_minus, worn_plus) = ends(drive), ends(worn)
    kept_items, shifted = (
        ((minus, worn_minus), worn_plus - plus) if depth_um > 0 else ((plus, worn_plus), worn_minus - minus)
    )
    np.testing.assert_array_equal(*kept_items)
    arm, depth = drive.reducer.pins.arm, 1e-3 * abs(depth_um)
    is_loaded = arm < 0 if depth_um > 0 else arm > 0
    of_pins = drive.gap[:, : drive.reducer.n_pins][:, is_loaded] / np.abs(arm[is_loaded])
    expected = np.min(of_pins + depth / np.abs(arm[is_loaded]), axis=1) - np.min(of_pins, axis=1)
    np.testing.assert_allclose(np.sign(depth_um) * shifted, expected, rtol=1e-12)


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
    np.testing.assert_array_equal(spring.without_twist.twist(torque), 0.0)


def test_softening_compliance_of_a_far_knee_is_the_torsion_of_the_output():
    drive, torque = small_drive(), np.linspace(-RATED, RATED, 9)
    soft, linear = put(drive, "softening_compliance", 0.04, 1e-3 * 1e4 * RATED), put(drive, "output_torsion", 0.04)
    np.testing.assert_allclose(soft.twist(torque), linear.twist(torque), rtol=1e-7)


def test_run_in_wears_over_the_cycles():
    drive = small_drive(4)
    cycles = np.array([0.0, 1.0, 5.0, np.inf])
    variant = put(drive, "run_in", 8.0, 2.5, conditions=Conditions(cycles, np.zeros(4)))
    n = drive.reducer.n_pins
    worn = 8e-3 * (1 - np.exp(-cycles / 2.5))
    np.testing.assert_allclose((variant.gap - drive.gap)[:, :n], np.repeat(worn[:, None], n, axis=1), atol=1e-15)
    np.testing.assert_array_equal((variant.gap - drive.gap)[:, n:], 0.0)


def test_thermal_growth_is_an_error_of_the_pin_circle():
    drive = small_drive(3)
    rise = np.array([0.0, 10.0, 40.0])
    variant = put(drive, "thermal_growth", 12.0, conditions=Conditions(np.zeros(3), rise))
    growth_um = 12.0 * SMALL.pin_circle_radius * 1e-3 * rise  # um/(m K) x m x K
    for state, um in enumerate(growth_um):
        np.testing.assert_allclose(variant.gap[state], put(drive, "pin_circle_error", um).gap[state], atol=1e-15)


@pytest.mark.parametrize("lobes", [2, 3])
def test_ovality_turned_with_the_crank_is_the_same_reducer(lobes):
    pitch = 2 * np.pi / SMALL.pins
    drives = [small_drive(crank=0.4 + turn * pitch, scale=0.0) for turn in range(SMALL.pins)]
    gap_at_start = put(drives[0], f"ovality_{lobes}", 10.0, 0.0).gap[0, : SMALL.pins]
    assert np.ptp(gap_at_start) > 5e-3
    for turn, drive in enumerate(drives):
        phase = lobes * turn * pitch
        variant = put(drive, f"ovality_{lobes}", 10 * np.cos(phase), 10 * np.sin(phase)).gap[0, : SMALL.pins]
        np.testing.assert_allclose(np.roll(variant, turn), gap_at_start, atol=1e-12)


@pytest.mark.parametrize("lobes", [2, 3])
def test_ovality_opens_as_much_as_it_closes_over_a_turn_of_the_crank(lobes):
    pitch, changes = 2 * np.pi / SMALL.pins, []
    for turn in range(SMALL.pins):
        drive = small_drive(crank=0.4 + turn * pitch, scale=0.0)
        drive = replace(drive, reading=replace(drive.reading, method="first_order"))
        variant = put(drive, f"ovality_{lobes}", 10.0, 0.0)
        changes.append(np.roll((variant.gap - drive.gap)[0, : SMALL.pins], turn))
    waves = np.abs(np.fft.rfft(changes, axis=0))  # over the crank, at every place of the flank
    assert np.all(waves[lobes] > 0.1 * SMALL.pins / 2 * 1e-3)
    waves[lobes] = 0.0
    np.testing.assert_allclose(waves, 0.0, atol=1e-12)


@pytest.mark.parametrize("lobes", [2, 3])
def test_ovality_displaces_every_pin_along_its_radius(lobes):
    drive = small_drive(scale=0.0)
    variant = put(drive, f"ovality_{lobes}", 3.0, -4.0)
    angle = np.angle(drive.reducer.pins.centre)
    expected = 5e-3 * np.cos(lobes * angle - np.arctan2(-4.0, 3.0))
    np.testing.assert_allclose(variant.errors.pin_radial[0], expected, atol=1e-15)


def turned(drive, torques, nodes):
    curve = backbone(drive, nodes)
    return output_path(torques, curve.torque, curve.angle[0], drive.sliders, Ripple()).at_turns[0]


def legs(*turns, steps=100):
    parts = [np.linspace(a, b, steps + 1)[1:] for a, b in zip(turns[:-1], turns[1:], strict=True)]
    return np.concatenate([[turns[0]], *parts])


def test_coulomb_parts_the_branches_by_twice_its_torque():
    drive, torque = small_drive(), 0.7  # [N m]
    nodes = torque_levels(60, 1.2)
    rubbing, torques = put(drive, "coulomb", torque), legs(0.0, RATED, -RATED, RATED)
    angle, curve = turned(rubbing, torques, nodes), backbone(drive, nodes)
    for part, sense in ((slice(120, 201), -1), (slice(220, 301), 1)):
        net_torque = torques[part] - sense * 1e3 * torque
        expected = np.interp(net_torque, curve.torque, curve.angle[0])
        np.testing.assert_allclose(angle[part], expected, atol=1e-12)


def test_presliding_slides_in_full_beyond_its_distance():
    drive, torque, distance = small_drive(), 0.7, 0.4
    variant = put(drive, "presliding", torque, distance).sliders
    slip = np.array([0.05, 0.25, 0.4, 0.8]) * distance / ARCMIN
    resisted = np.sum(np.minimum(variant.stiffness * slip[:, None], variant.limit), axis=1)
    parts = np.array([[0.05 / 0.25, 0.05 / 0.5, 0.05 / 0.75, 0.05], [1, 0.5, 1 / 3, 0.25], [1, 0.8, 0.4 / 0.75, 0.4]])
    np.testing.assert_allclose(resisted[:3], 1e3 * torque * parts.mean(axis=1), rtol=1e-12)
    full = np.sum(np.minimum(variant.stiffness * distance / ARCMIN, variant.limit))
    np.testing.assert_allclose(full, 1e3 * torque, rtol=1e-12)


def test_load_friction_parts_the_branches_in_proportion_to_the_torque():
    drive, share = small_drive(), 0.15
    nodes = torque_levels(60, 1.2)
    rubbing, torques = put(drive, "load_friction", share), legs(0.0, RATED, -RATED, RATED)
    angle, curve = turned(rubbing, torques, nodes), backbone(drive, nodes)
    is_loaded = np.abs(torques) > 0.01 * RATED
    for leg_start, leg_end, sense in ((120, 201, -1), (220, 301, 1)):
        leg_rows = np.arange(leg_start, leg_end)
        leg_rows = leg_rows[is_loaded[leg_rows]]
        carried_torque = torques[leg_rows] / (1 + share * sense * np.sign(torques[leg_rows]))
        np.testing.assert_allclose(angle[leg_rows], np.interp(carried_torque, curve.torque, curve.angle[0]), atol=1e-12)
        assert np.sum(sense * torques[leg_rows] < 0) > 20


def test_friction_at_the_pins_alone_needs_pins_that_stand_still():
    assert [name for name in LIBRARY if STILL in LIBRARY[name].needs] == ["contact_friction"]
    assert not LIBRARY["load_friction"].needs


def test_friction_of_contacts_is_at_the_pins_alone():
    drive = small_drive()
    variant = put(drive, "contact_friction", 0.08).sliders
    np.testing.assert_array_equal(variant.contact, np.arange(drive.reducer.n_pins))
    np.testing.assert_array_equal(variant.coefficient, 0.08)
    assert not np.any(variant.limit)


def test_clearance_of_the_bearing_widens_the_play():
    drive = small_drive(3, scale=1 * MICROMETRE)
    variant = put(drive, "bearing_clearance", 4.0)
    expected = general_play(drive.reducer, drive.gap, np.full(3, 4e-3)).backlash
    curve = backbone(variant, SHARES)
    np.testing.assert_allclose(curve.angle[:, MIDDLE] - curve.angle[:, MIDDLE - 1], expected, rtol=1e-3)
    assert np.all(expected > 1.05 * separated_play(drive.reducer, drive.gap).backlash)


@pytest.mark.parametrize(
    ("name", "error"),
    [("eccentricity_error", "eccentricity"), ("pin_circle_error", "pin_radial"), ("pin_radius_error", "pin_radius")],
)
def test_error_of_a_dimension_gives_its_exact_gaps(name, error):
    drive = small_drive(2)
    error_before = getattr(drive.errors, error)
    errors = replace(drive.errors, **{error: error_before + 6e-3})
    expected = gaps(drive.profile, drive.reducer, errors, **vars(drive.reading))
    np.testing.assert_allclose(put(drive, name, 6.0).gap, expected, atol=1e-15)


def test_preload_closes_every_gap_of_the_pins():
    drive, n = small_drive(2), SMALL.pins
    increment = put(drive, "preload", 3.0).gap - drive.gap
    np.testing.assert_allclose(increment[:, :n], -3e-3, atol=1e-15)
    np.testing.assert_array_equal(increment[:, n:], 0.0)
    thicker = put(drive, "pin_radius_error", 3.0).gap - drive.gap  # the same to the pins' gaps
    np.testing.assert_allclose(increment[:, :n], thicker[:, :n], atol=1e-12)


def test_rayleigh_loops_have_their_closed_area_and_forget_inner_loops():
    """Area 4/3 eta T^3 (Rayleigh 1887); a minor loop closes and leaves no trace; the remanent twist is eta T^2 / 2."""
    eta, top = 3e-9, 12e3
    ramp = np.linspace(0.0, top, 4001)
    cycle = np.concatenate([ramp, ramp[-2::-1], -ramp[1:], -ramp[-2::-1], ramp[1:]])
    twist = rayleigh_twist(cycle, eta)
    loop = slice(len(ramp) - 1, None)
    area = abs(np.trapezoid(twist[loop], cycle[loop]))
    assert area == pytest.approx(4 / 3 * eta * top**3, rel=1e-6)
    assert twist[len(ramp) - 1] == twist[-1] == pytest.approx(eta * top**2)
    assert twist[2 * len(ramp) - 2] == pytest.approx(0.5 * eta * top**2)
    inner = rayleigh_twist(
        np.array([0.0, top, -0.5 * top, 0.3 * top, -0.2 * top, 0.3 * top, -0.5 * top, 0.8 * top]), eta
    )
    direct = rayleigh_twist(np.array([0.0, top, -0.5 * top, 0.8 * top]), eta)
    assert inner[-1] == pytest.approx(direct[-1], rel=1e-12)


def test_rayleigh_is_the_sum_of_plays_of_every_width():
    """Preisach's model of constant density, along random torques, by brute force."""
    eta, torque = 2e-9, np.cumsum(np.random.default_rng(3).normal(0, 4e3, 60))
    half = np.max(np.abs(torque)) * (np.arange(4000) + 0.5) / 4000
    play_positions, summed = np.zeros(4000), []
    for load in torque:
        play_positions = np.clip(play_positions, load - half, load + half)
        summed.append(2 * eta * (half[1] - half[0]) * play_positions.sum())
    np.testing.assert_allclose(rayleigh_twist(torque, eta), summed, rtol=1e-4, atol=1e-5 * np.max(np.abs(summed)))


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


def test_friction_resists_the_rising_load_by_one_share_and_the_falling_by_another():
    """While the load rises T = (1 + a) carried, while it falls (1 - b) carried; alike, it is load_friction."""
    drive, loading, unloading = small_drive(play=0.0), 0.3, 0.1
    variant = put(drive, "directional_load_friction", loading, unloading)
    leaning = 1 + variant.lean
    nodes, angles = np.linspace(-2, 2, 41) * RATED, np.linspace(-2, 2, 41) * 1e-3
    torque = RATED * np.concatenate([np.linspace(0, 1, 50), np.linspace(1, 0.2, 50)])
    path = output_path(torque, leaning * nodes, angles, variant.sliders.of_scaled_load(leaning), Ripple())
    carried_torque = path.at_turns[1] / leaning
    assert carried_torque[49] == pytest.approx(RATED / (1 + loading), rel=1e-2)
    assert carried_torque[-1] == pytest.approx(0.2 * RATED / (1 - unloading), rel=1e-2)
    equal_directions = put(drive, "directional_load_friction", 0.2, 0.2)
    reference = put(drive, "load_friction", 0.2)
    assert equal_directions.lean == 0.0
    np.testing.assert_array_equal(equal_directions.sliders.coefficient, reference.sliders.coefficient)
