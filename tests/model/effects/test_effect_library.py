"""Every effect of the library: its texts and bounds, no size, no trace in its drive, twice the same."""

import numpy as np
import pytest
from drives import small_drive
from drives_with_effects import LIBRARY, MIDDLE, SHARES, put
from reducers import ARCMIN, PAPER, SMALL

from pipeline.identification.bench.instrument_effects import instrument_effects
from pipeline.model.effects import Conditions
from pipeline.model.effects.effect import (
    CRANKS,
    CYCLES,
    FLANGE,
    LOOPS,
    MOVES,
    RATE,
    SENSES,
    STILL,
    TEMPERATURE,
    TIME,
    TORQUES,
    Parameter,
)
from pipeline.model.elements import Path
from pipeline.model.load_history.backbone import backbone

EVERY = pytest.mark.parametrize("name", LIBRARY)
ALL_NAMES = {**LIBRARY, **instrument_effects()}


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
    assert len({parameter.name for parameter in effect.parameters}) == len(effect.parameters)
    assert set(effect.confused_with) <= set(ALL_NAMES) - {name}
    assert effect.limit_case in {"", *ALL_NAMES}
    assert effect.starts in ("secants", "periods")
    assert effect.needs <= {CRANKS, CYCLES, TIME, TEMPERATURE, STILL, RATE, LOOPS, SENSES, TORQUES, FLANGE, MOVES}


@pytest.mark.parametrize(
    ("name", "unit", "quantity"),
    [
        ("stiffness_Nm_per_arcmin", "N m/arcmin", "stiffness"),
        ("coefficient_arcmin_per_Nm2", "arcmin/(N m)2", "coefficient"),
        ("difference_um_per_m_K", "um/(m K)", "difference"),
        ("loss_per_K", "1/K", "loss"),
        ("half_life_s", "s", "half life"),
        ("number_of_cycles", "1", "number of cycles"),
    ],
)
def test_the_name_of_a_parameter_ends_in_its_unit(name, unit, quantity):
    assert Parameter(name, unit, "any").quantity == quantity
    if unit != "1":
        with pytest.raises(
            ValueError,
            match=f"size: the name of a number in .* must end in {name.removeprefix(quantity.replace(' ', '_'))}",
        ):
            Parameter("size", unit, "any")


@EVERY
def test_bounds_are_finite_and_ordered(name):
    pairs = LIBRARY[name].bounds(small_drive())
    assert len(pairs) == len(LIBRARY[name].parameters)
    assert np.all(np.isfinite(pairs))
    assert all(low < high for low, high in pairs)


@pytest.mark.parametrize("profile", [SMALL, PAPER], ids=["small", "paper"])
def test_gaps_open_by_a_third_of_the_eccentricity_and_close_by_a_thirtieth(profile):
    drive, unit = small_drive(profile=profile), 1e3 * profile.eccentricity
    assert LIBRARY["pin_circle_error"].bounds(drive) == (pytest.approx((-unit / 30, unit / 3)),)
    for runout in ("pin_circle_runout", "flank_runout"):
        assert LIBRARY[runout].bounds(drive) == (pytest.approx((-unit / 3, unit / 3)),) * 2


@pytest.mark.parametrize("profile", [SMALL, PAPER], ids=["small", "paper"])
@pytest.mark.parametrize("name", ["output_torsion", "creep", "softening_compliance"])
def test_bounds_of_a_twist_hold_the_drives_own_and_little_more(name, profile):
    drive = small_drive(scale=0.0, play=0.0, profile=profile)
    curve = backbone(drive, SHARES)
    twist_of_drive = 1e3 * ARCMIN * np.ptp(curve.angle[0, MIDDLE:]) / np.ptp(curve.torque[MIDDLE:])  # [arcmin/(N m)]
    _, high = LIBRARY[name].bounds(drive)[0]
    assert 2 * twist_of_drive < high < 100 * twist_of_drive


def twist_along(drive):
    """Twist [rad] of the elements with memory along a loop that takes a minute."""
    torque = np.concatenate([np.linspace(0, 1e3, 9), np.linspace(1e3, -1e3, 9)])
    path = Path(torque, np.linspace(0.0, 60.0, len(torque)))
    return sum((element.twist(path) for element in drive.hystereses), np.zeros(len(torque)))


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
    assert len(variant.sliders.acting) == 0
    assert not np.any(twist_along(variant))
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
    drive, effect = small_drive(1), LIBRARY[name]
    values = [low + 0.6 * (high - low) for low, high in effect.bounds(drive)]
    conditions = Conditions(np.array([3.0]), np.array([15.0]))
    single_change = put(drive, name, *values, conditions=conditions)
    double_change = put(single_change, name, *values, conditions=conditions)
    if len(single_change.sliders):
        assert len(double_change.sliders) == 2 * len(single_change.sliders)
    torque = np.array([-1e3, -0.0, 0.0, 1e3])
    np.testing.assert_allclose(double_change.twist(torque), 2 * single_change.twist(torque))
    np.testing.assert_allclose(twist_along(double_change), 2 * twist_along(single_change))
    np.testing.assert_allclose(
        double_change.laws.linear - single_change.laws.linear, single_change.laws.linear - drive.laws.linear
    )
    np.testing.assert_allclose(double_change.shift - single_change.shift, single_change.shift - drive.shift, atol=1e-15)
    for key, value in vars(double_change.errors).items():
        error_of_one = getattr(single_change.errors, key)
        np.testing.assert_allclose(value - error_of_one, error_of_one - getattr(drive.errors, key), atol=1e-15)
