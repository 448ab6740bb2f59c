"""The discrepancy term against processes of known size, and its likelihood against a density."""

import numpy as np
import pytest
from scipy import stats

from pipeline.identification.selection.statements.discrepancy import discrepancy, restricted_likelihood

TORQUE = np.tile(np.linspace(-12, 12, 24), 6)
SENSE = np.tile(np.repeat([1.0, -1.0], 24), 3)
POSITION = np.repeat([0, 1, 2], 48)
SLOPE = TORQUE[:, None]


def drawn(seed: int, common: float, individual: float, reach: float, noise: float = 0.1) -> np.ndarray:
    """A process of known sizes [arcmin] and reach [N m], with noise."""
    rng = np.random.default_rng(seed)
    correlation = np.exp(-0.5 * ((TORQUE[:, None] - TORQUE) / reach) ** 2) * (SENSE[:, None] == SENSE)
    covariance = common**2 * correlation + individual**2 * correlation * (POSITION[:, None] == POSITION)
    values = rng.multivariate_normal(np.zeros(len(TORQUE)), covariance, method="eigh")
    return values + noise * rng.standard_normal(len(TORQUE))


def found(residual, sigma=0.1, jacobian=SLOPE):
    return discrepancy(TORQUE, SENSE, POSITION, residual, np.full(len(TORQUE), sigma), jacobian)


@pytest.mark.long
def test_sizes_and_reach_of_a_process_are_found():
    fits = [found(drawn(seed, 2.0, 0.7, 3.0), jacobian=np.zeros((len(TORQUE), 0))) for seed in range(5)]
    assert np.median([fit.reach_Nm for fit in fits]) == pytest.approx(3.0, rel=0.3)
    assert np.median([fit.common_arcmin for fit in fits]) == pytest.approx(2.0, rel=0.35)
    assert np.median([fit.own_arcmin for fit in fits]) == pytest.approx(0.7, rel=0.35)
    assert min(fit.structured for fit in fits) > 0.95


def test_noise_alone_has_little_structure():
    fits = [found(drawn(seed, 0.0, 0.0, 3.0)) for seed in range(4)]
    assert np.median([fit.structured for fit in fits]) < 0.15
    assert np.median([fit.common_arcmin for fit in fits]) < 0.1


@pytest.mark.long
def test_the_interval_of_a_parameter_holds_it_beside_structure_where_least_squares_does_not():
    covered_by_process, reference = 0, 0
    for seed in range(8):
        residual = drawn(seed, 1.0, 0.5, 4.0) + 0.1 * TORQUE
        slope = np.sum(TORQUE * residual) / np.sum(TORQUE**2)
        reference += abs(slope - 0.1) < 2 * 0.1 / np.sqrt(np.sum(TORQUE**2))
        fit = found(residual - slope * TORQUE)
        covered_by_process += abs(slope + fit.moved[0] - 0.1) < 2 * fit.error[0]
    assert covered_by_process >= 6
    assert reference <= 3


def test_one_position_parts_nothing_from_what_is_shared():
    is_first_position = POSITION == 0
    cells = (
        part[is_first_position]
        for part in (TORQUE, SENSE, POSITION, drawn(1, 2.0, 0.0, 3.0), np.full(len(TORQUE), 0.1), SLOPE)
    )
    single_result = discrepancy(*cells)
    assert np.isnan(single_result.own_arcmin)
    assert single_result.common_arcmin > 0.5


def test_the_place_of_the_structure_is_found():
    bump = 3.0 * np.exp(-0.5 * ((TORQUE - 6) / 1.5) ** 2) * (SENSE > 0)
    fit = found(drawn(1, 0.0, 0.0, 1.0) + bump)
    assert fit.worst_torque_Nm == pytest.approx(6.0, abs=1.1)
    assert fit.worst_sense == 1
    assert fit.worst_arcmin > 1.0


def test_the_restricted_likelihood_is_the_density_of_contrasts():
    rng = np.random.default_rng(3)
    design, root = rng.standard_normal((9, 2)), rng.standard_normal((9, 9))
    covariances = [root @ root.T + np.eye(9), np.diag(rng.uniform(1, 2, 9))]
    values = rng.standard_normal(9)
    contrasts = np.linalg.svd(design)[0][:, 2:]  # what the design does not reach
    densities = [
        stats.multivariate_normal(cov=contrasts.T @ fit @ contrasts).logpdf(contrasts.T @ values) for fit in covariances
    ]
    model_value = [restricted_likelihood(fit, design, values) for fit in covariances]
    assert model_value[0] - model_value[1] == pytest.approx(densities[0] - densities[1], rel=1e-9)
