"""The rough model that ranks pitches, against its definition solved by bisection; its fits, against exact answers."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from pipeline.populations.turn_forces import PinForces, fitted_slopes
from pipeline.populations.turn_gaps import NEVER_CLOSED, SeparateGaps
from pipeline.populations.turn_ranking import WAVES, Ranking, SpringWork, waves
from pipeline.populations.turn_springs import MOMENTS, OF_SENSE, Springs

N, PINS, LOBES, PLACES, DISKS, HOLES = 2, 3, 2, 7, 2, 3
PITCHES = np.arange(PINS * LOBES)
ARM = np.array([-20.0, 15.0, -10.0, 12.0, -18.0, 25.0, 1e-15])
"""[mm] Three places close in each sense; the last one, on the way to the axis, in none."""
DISK = np.array([0, 0, 0, 1, 1, 1, 1])
PRESSURE = np.linspace(50.0, 90.0, PLACES)


@pytest.fixture(scope="module")
def rough() -> tuple[Springs, SeparateGaps]:
    """Springs of two disks, with three output pins in the holes of each, of which one or two close in a sense."""
    rng = np.random.default_rng(8)
    springs = Springs(
        arm=ARM,
        disk=DISK,
        stiffness=ARM**2 * rng.uniform(2e4, 6e4, PLACES),
        output_stiffness=rng.uniform(5e6, 2e7, (LOBES, DISKS, HOLES)),
        output_waves=rng.normal(size=(LOBES, DISKS, HOLES, 2 * MOMENTS + 1)),
        levels=np.array([400.0, 6e3, 1.2e4]),
    )
    of_pins, of_lobes = (rng.uniform(0.0, 0.01, (N, count, PLACES)) for count in (PINS, LOBES))
    of_pins[..., -1] = -0.004  # overlaps where no rotation helps
    output = rng.uniform(0, 2e-4, (N, LOBES, 2, DISKS, HOLES))
    output[:, :, 0, :, 0] = output[:, :, 1, :, 1:] = NEVER_CLOSED
    return springs, SeparateGaps(of_pins, of_lobes, output)


def moment(ends: np.ndarray, stiffness: np.ndarray, angle: float) -> float:
    """Of springs at a rotation."""
    return float(np.sum(stiffness * np.maximum(angle - ends, 0.0)))


def disk_moment(pins: tuple, output: tuple, theta: float) -> float:
    """Moment of a disk at a rotation of the output: that of its pins is that of the output on it."""
    low, high = -1.0, 1.0 + theta
    phi = brentq(lambda angle: moment(*pins, angle) - moment(*output, theta - angle), low, high, xtol=1e-16)
    return moment(*pins, phi)


@pytest.mark.parametrize("sense", [0, 1])
def test_rotations_balance_the_torque_of_disks_that_share_it(rough, sense: int) -> None:
    springs, gaps = rough
    features = springs.features(gaps)
    assert features.shape == (N, PINS * LOBES, 2 * OF_SENSE)
    shares = []
    for unit, pitch in np.ndindex(N, PINS * LOBES):
        gap = gaps.of_pins[unit, pitch % PINS] + gaps.of_lobes[unit, pitch % LOBES]
        bodies = []
        for disk in range(DISKS):
            rows = (disk == DISK) & ((1.0, -1.0)[sense] * ARM < -1e-9)
            behind = gaps.output[unit, pitch % LOBES, sense, disk], springs.output_stiffness[pitch % LOBES, disk]
            bodies.append(((gap[rows] / np.abs(ARM[rows]), springs.stiffness[rows]), behind))
        found = features[unit, pitch, sense * OF_SENSE : (sense + 1) * OF_SENSE]
        first = min(pins[0].min() + output[0].min() for pins, output in bodies)
        assert found[0] == pytest.approx(first, rel=1e-12)
        for torque, rotation in zip(springs.levels, found[1:4], strict=True):

            def excess(theta, torque=torque, bodies=bodies):
                return sum(disk_moment(*body, theta) for body in bodies) - torque

            assert rotation == pytest.approx(brentq(excess, first, 1.0, xtol=1e-15), rel=1e-9)
        largest = max(disk_moment(*body, found[3]) for body in bodies)
        assert found[4] == pytest.approx(largest / springs.levels[-1], rel=1e-6)
        shares.append(found[4])
    assert np.ptp(shares) > 0.05


@pytest.mark.long
def test_rotations_of_a_single_disk_balance_each_torque(rough) -> None:
    """What is behind it does not give way: its play is added to the rotation at which each pin closes."""
    springs, gaps = rough
    springs = replace(springs, disk=np.zeros(PLACES, int), output_stiffness=np.full((LOBES, 1, 1), 1e12))
    gaps = replace(gaps, output=np.random.default_rng(5).uniform(0, 2e-4, (N, LOBES, 2, 1, 1)))
    features = springs.features(gaps).reshape(N, PINS * LOBES, 2, OF_SENSE)
    for unit, pitch, sense in np.ndindex(N, PINS * LOBES, 2):
        rows = (1.0, -1.0)[sense] * ARM < -1e-9
        gap = gaps.of_pins[unit, pitch % PINS] + gaps.of_lobes[unit, pitch % LOBES]
        ends = gap[rows] / np.abs(ARM[rows]) + gaps.output[unit, pitch % LOBES, sense, 0, 0]
        found = features[unit, pitch, sense]
        assert found[0] == pytest.approx(ends.min(), rel=1e-12)
        assert found[4] == 1.0
        moments = [moment(ends, springs.stiffness[rows], angle) for angle in found[1:4]]
        np.testing.assert_allclose(moments, springs.levels, rtol=1e-9)


def test_loads_by_the_output_are_those_of_springs_under_a_part_of_the_torque(rough) -> None:
    springs, gaps = rough
    loads = springs.output_loads(gaps, 1).reshape(N, LOBES, DISKS, -1)
    for unit, lobe, disk in np.ndindex(N, LOBES, DISKS):
        ends, stiffness = gaps.output[unit, lobe, 1, disk], springs.output_stiffness[lobe, disk]
        part = springs.levels[-1] / DISKS
        angle = brentq(lambda phi, *body, part=part: moment(*body, phi) - part, 0, 1, (ends, stiffness), xtol=1e-15)
        moments = stiffness * np.maximum(angle - ends, 0.0)
        expected = np.append(angle, moments @ springs.output_waves[lobe, disk])
        np.testing.assert_allclose(loads[unit, lobe, disk], expected, rtol=1e-9)


@pytest.fixture(scope="module")
def forces(rough) -> PinForces:
    """Any slopes, so that some forces are below 0."""
    springs, gaps = rough
    rng, loads = np.random.default_rng(4), springs.output_loads(gaps, 0).shape[2]
    counts = [len(springs.closing(sense)) for sense in range(2)]
    scale = np.concatenate([np.full(counts[0], 1e4), np.full(loads, 3e-3)])
    first = tuple(rng.normal(size=(1 + count + loads, count)) * np.append(50.0, scale)[:, None] for count in counts)
    second = tuple(rng.normal(size=(1 + 2 * count + loads, count)) for count in counts)
    return PinForces(springs, PRESSURE, first, second)


def test_peaks_and_sums_of_all_pitches_are_those_of_single_ones(rough, forces: PinForces) -> None:
    springs, gaps = rough
    of_pairs = np.split(forces.at(gaps, PITCHES), 2, axis=2)  # as many places close in both senses
    slopes = [np.random.default_rng(sense).normal(size=(of_pairs[sense].shape[2], 2)) for sense in range(2)]
    peaks, sums = forces.peaks_and_sums(gaps, slopes)
    expected = []
    for sense, (values, second) in enumerate(zip(of_pairs, forces.second, strict=True)):
        carried = np.maximum(values @ second[1:] + second[0], 0.0)
        expected.append(np.max(PRESSURE[springs.closing(sense)] * np.sqrt(carried), axis=2))
        none = values[..., -len(springs.closing(sense)) :] == 0.0
        assert 0.1 < none.mean() < 0.9
    np.testing.assert_allclose(peaks, np.stack([*expected, np.maximum(*expected)], axis=-1), rtol=1e-4)
    np.testing.assert_allclose(sums, of_pairs[0] @ slopes[0] + of_pairs[1] @ slopes[1], rtol=1e-4, atol=1e-3)


def test_forces_of_a_unilateral_law_are_found(rough) -> None:
    """Forces that are the larger of 0 and what is linear in the gaps."""
    springs, gaps = rough
    rng = np.random.default_rng(6)
    many = SeparateGaps(*(np.repeat(part, 40, axis=0) for part in vars(gaps).values()))
    many = SeparateGaps(*(rng.uniform(0.0, 0.01, part.shape) for part in (many.of_pins, many.of_lobes)), many.output)
    slopes = 1e4 * rng.normal(size=(2, 3, 3))
    force = np.zeros((len(many.of_pins), len(PITCHES), 2, PLACES))
    gap = many.of_pins[:, PITCHES % PINS] + many.of_lobes[:, PITCHES % LOBES]
    for sense in range(2):
        rows = springs.closing(sense)
        force[:, :, sense, rows] = np.maximum(100.0 - gap[..., rows] @ slopes[sense], 0.0)
    missed_force = force.copy()
    missed_force[0, 0, 0] = np.nan  # a state without a result is left out
    fitted = PinForces.from_pairs(springs, PRESSURE, many, PITCHES, missed_force)
    none = [np.zeros((len(second) - 1, 0)) for second in fitted.second]
    peaks = fitted.peaks_and_sums(many, none)[0][..., 2]
    true = np.max(PRESSURE * np.sqrt(force), axis=(2, 3))
    assert np.corrcoef(peaks.ravel(), true.ravel())[0, 1] > 0.98


@pytest.mark.parametrize("jointly", [False, True])
def test_a_ranking_of_metrics_that_are_linear_in_what_it_knows_is_exact(
    jointly: bool, rough, forces: PinForces
) -> None:
    springs, gaps = rough
    rng = np.random.default_rng(9)
    many = SeparateGaps(*(np.repeat(part, 40, axis=0) for part in vars(gaps).values()))
    many = SeparateGaps(*(rng.uniform(0.0, 0.01, part.shape) for part in (many.of_pins, many.of_lobes)), many.output)
    peaks, _ = forces.peaks_and_sums(many, [np.zeros((len(second) - 1, 0)) for second in forces.second])
    known = [springs.features(many) * 1e4, peaks, np.broadcast_to(waves(PITCHES, LOBES), (*peaks.shape[:2], 2 * WAVES))]
    known.append(forces.at(many, PITCHES))
    parts = [part @ rng.normal(size=part.shape[2]) for part in known]
    metric = 3.0 + sum(part / max(part.std(), 1.0) for part in parts)
    metrics = {"metric": metric, "constant": np.ones(metric.shape), "few": np.where(np.arange(6) < 1, metric, np.nan)}
    metrics["few"][1:] = np.nan
    ranking = Ranking.from_pairs(springs, forces, many, PITCHES, metrics, jointly)
    assert ranking.names == ("metric",)
    found = ranking.predict_values(many)["metric"]
    assert np.abs(found - metric).max() < 1e-2 * metric.std()


def test_waves_are_harmonics_that_come_back_after_all_lobes() -> None:
    turn = waves(np.arange(14), 7)
    np.testing.assert_array_equal(turn[:7], turn[7:])
    np.testing.assert_allclose(turn[2, :4], np.cos(2 * np.pi * 2 / 7 * np.arange(1, 5)), atol=1e-15)
    np.testing.assert_allclose(turn[2, 4:], np.sin(2 * np.pi * 2 / 7 * np.arange(1, 5)), atol=1e-15)


def spring_compliance(deflection: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Of states in two parts."""
    work = SpringWork(force.shape[1])
    for part in (slice(None, 3), slice(3, None)):
        work.add(deflection[part], force[part])
    return work.compliance


def test_compliance_of_linear_springs_is_their_own_and_of_idle_ones_that_of_all() -> None:
    rng = np.random.default_rng(2)
    own, force = np.array([2e-6, 5e-6, 1e-6]), rng.uniform(0, 100, (8, 3))
    force[:, 2] = 0.0
    deflection = own * force
    deflection[3], force[3] = np.nan, 1e6  # a state without a result
    found = spring_compliance(deflection, force)
    kept = np.delete(force, 3, axis=0)
    of_all = np.sum(own * kept**2) / np.sum(kept**2)
    np.testing.assert_allclose(found, [2e-6, 5e-6, of_all], rtol=1e-12)
    assert spring_compliance(-deflection, force).min() == 1e-12  # never a spring that pulls


def test_slopes_of_an_exact_plane_are_found() -> None:
    rng = np.random.default_rng(3)
    features = np.column_stack([rng.normal(5.0, 1e-4, 60), rng.normal(0.0, 300.0, 60), np.full(60, 7.0)])
    plane = 2.0 + 3e4 * features[:, :1] - 0.01 * features[:, 1:2]
    slopes = fitted_slopes(features, plane)
    assert slopes[1:, 0] == pytest.approx([3e4, -0.01, 0.0], rel=1e-5, abs=1e-9)
    np.testing.assert_allclose(slopes[0] + features @ slopes[1:], plane, rtol=1e-5)
