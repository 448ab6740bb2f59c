"""The rough model that ranks pitches, against its definition solved by bisection; its fits, against exact answers."""

import numpy as np
import pytest
from scipy.optimize import brentq

from pipeline.populations.turn_ranking import (
    WAVES,
    Ranking,
    SeparateGaps,
    Springs,
    fitted_slopes,
    place_compliance,
    waves,
)

N, PINS, LOBES, PLACES = 2, 3, 2, 6


@pytest.fixture(scope="module")
def rough() -> tuple[Springs, SeparateGaps]:
    """Springs of six places on two disks, three of which close in each sense."""
    rng = np.random.default_rng(8)
    arm = np.array([-20.0, 15.0, -10.0, 12.0, -18.0, 25.0])
    springs = Springs(
        arm=arm,
        disk=np.array([0, 0, 0, 1, 1, 1]),
        stiffness=arm**2 * rng.uniform(2e4, 6e4, PLACES),
        pressure=rng.uniform(50.0, 90.0, PLACES),
        levels=np.array([400.0, 6e3, 1.2e4]),
        spread=np.eye(PLACES) + 0.1 * rng.uniform(size=(PLACES, PLACES)),
    )
    of_pins, of_lobes = (rng.uniform(0.0, 0.01, (N, count, PLACES)) for count in (PINS, LOBES))
    output = np.stack([rng.uniform(0, 2e-4, (N, LOBES, 2)), -rng.uniform(0, 2e-4, (N, LOBES, 2))], axis=-1)
    return springs, SeparateGaps(of_pins, of_lobes, output)


def closing(springs: Springs, gaps: SeparateGaps, unit: int, pitch: int, sense: int) -> tuple[np.ndarray, np.ndarray]:
    """Places that close in a sense, and the rotations at which they do."""
    sign = (1.0, -1.0)[sense]
    places = np.array([k for k in range(PLACES) if sign * springs.arm[k] < 0])
    gap = gaps.of_pins[unit, pitch % PINS] + gaps.of_lobes[unit, pitch % LOBES]
    behind = gaps.output[unit, pitch % LOBES, springs.disk, sense]
    return places, (gap / np.abs(springs.arm) + sign * behind)[places]


def test_rotations_balance_the_torque_and_pressures_follow_from_the_spread_forces(rough) -> None:
    springs, gaps = rough
    features = springs.features(gaps)
    assert features.shape == (N, PINS * LOBES, 11)
    n_closed = set()
    for unit in range(N):
        for pitch in range(PINS * LOBES):
            peaks = []
            for sense in range(2):
                places, ends = closing(springs, gaps, unit, pitch, sense)
                stiffness = springs.stiffness[places]
                found = features[unit, pitch, 5 * sense : 5 * sense + 5]
                assert found[0] == pytest.approx(ends.min(), rel=1e-12)
                for torque, rotation in zip(springs.levels, found[1:4], strict=True):

                    def excess(phi, torque=torque, stiffness=stiffness, ends=ends):
                        return np.sum(stiffness * np.maximum(phi - ends, 0.0)) - torque

                    assert rotation == pytest.approx(brentq(excess, ends.min(), 1.0, xtol=1e-15), rel=1e-9)
                force = np.zeros(PLACES)
                force[places] = stiffness * np.maximum(found[3] - ends, 0.0) / np.abs(springs.arm[places])
                n_closed.add(np.count_nonzero(force))
                carried = (force @ springs.spread)[places]
                peaks.append(np.sqrt(np.max(springs.pressure[places] ** 2 * carried)))
                assert found[4] == pytest.approx(peaks[-1], rel=1e-9)
            assert features[unit, pitch, 10] == pytest.approx(max(peaks), rel=1e-9)
    assert len(n_closed) > 1  # some springs stay open


def test_the_spread_of_forces_is_found_where_it_is_linear(rough) -> None:
    springs, gaps = rough
    pitches, true_spread = np.arange(PINS * LOBES), springs.spread
    force = np.zeros((N, len(pitches), 2, PLACES))
    for unit, pitch, sense in np.ndindex(force.shape[:3]):
        places, ends = closing(springs, gaps, unit, pitch, sense)
        stiffness = springs.stiffness[places]
        phi = springs.features(gaps)[unit, pitch, 5 * sense + 3]
        force[unit, pitch, sense, places] = stiffness * np.maximum(phi - ends, 0.0) / np.abs(springs.arm[places])
    force = force @ true_spread
    force[0, 0, 0] = np.nan  # a state without a result is left out
    fitted = springs.with_fitted_spread(gaps, pitches, force).spread
    assert np.abs(fitted - true_spread).max() < 0.1
    rough_error, error = np.abs(np.eye(PLACES) - true_spread).mean(), np.abs(fitted - true_spread).mean()
    assert error < 0.3 * rough_error


def test_a_prediction_is_linear_in_features_and_waves(rough) -> None:
    springs, gaps = rough
    features, turn = springs.features(gaps), waves(np.arange(PINS * LOBES), LOBES)
    slope = np.arange(1.0, 2 + features.shape[2] + 2 * WAVES)
    predicted = Ranking(springs, {"metric": slope}, {}).predict_metrics(gaps)["metric"]
    unit, pitch = 1, 4
    expected = slope @ np.concatenate([[1.0], features[unit, pitch], turn[pitch]])
    assert predicted[unit, pitch] == pytest.approx(expected)


def test_waves_are_harmonics_that_come_back_after_all_lobes() -> None:
    turn = waves(np.arange(14), 7)
    np.testing.assert_array_equal(turn[:7], turn[7:])
    np.testing.assert_allclose(turn[2, :4], np.cos(2 * np.pi * 2 / 7 * np.arange(1, 5)), atol=1e-15)
    np.testing.assert_allclose(turn[2, 4:], np.sin(2 * np.pi * 2 / 7 * np.arange(1, 5)), atol=1e-15)


def test_compliance_of_linear_springs_is_their_own_and_of_idle_ones_that_of_all() -> None:
    rng = np.random.default_rng(2)
    own, force = np.array([2e-6, 5e-6, 1e-6]), rng.uniform(0, 100, (8, 3))
    force[:, 2] = 0.0
    deflection = own * force
    deflection[3], force[3] = np.nan, 1e6  # a state without a result
    found = place_compliance(deflection, force)
    kept = np.delete(force, 3, axis=0)
    of_all = np.sum(own * kept**2) / np.sum(kept**2)
    np.testing.assert_allclose(found, [2e-6, 5e-6, of_all], rtol=1e-12)
    assert place_compliance(-deflection, force).min() == 1e-12  # never a spring that pulls


def test_slopes_of_an_exact_plane_are_found_and_a_constant_has_none() -> None:
    rng = np.random.default_rng(3)
    features = np.column_stack([rng.normal(5.0, 1e-4, 60), rng.normal(0.0, 300.0, 60), np.full(60, 7.0)])
    plane = 2.0 + 3e4 * features[:, 0] - 0.01 * features[:, 1]
    plane[5] = np.nan
    slopes = fitted_slopes(
        features, {"plane": plane, "constant": np.ones(60), "few": np.where(np.arange(60) < 6, plane, np.nan)}
    )
    assert set(slopes) == {"plane"}
    assert slopes["plane"][1:] == pytest.approx([3e4, -0.01, 0.0], rel=1e-6, abs=1e-9)
    predicted = slopes["plane"][0] + features @ slopes["plane"][1:]
    np.testing.assert_allclose(np.delete(predicted, 5), np.delete(plane, 5), rtol=1e-9)
