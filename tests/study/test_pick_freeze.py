"""Units of the pick-freeze design: the study's own samples, and one group's errors exchanged between them."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from pipeline.config import load_study
from pipeline.config.dimensions.pins import oval_shift
from pipeline.config.distributions.shipped import Fixed
from pipeline.config.studies.study import Drivers
from pipeline.config.studies.tolerances import Tolerances
from pipeline.sampling.errors import draw
from pipeline.sampling.pick_freeze import draw_mixed, drawn_units, error_groups

QUICK = load_study("quick", Path(__file__).parents[2])
N = 20
GROUPS = error_groups(QUICK)


def study(tolerances=QUICK.tolerances, **samples):
    return QUICK.model_copy(
        update={
            "samples": QUICK.samples.model_copy(update=samples),
            "drivers": Drivers(base_samples=N),
            "tolerances": tolerances,
        }
    )


def parts(errors):
    """Errors by group: the ovalities' amplitude and phase, and the pins' radial errors without them."""
    values = {field.name: getattr(errors, field.name) for field in fields(errors)}
    for order in (2, 3):
        amplitude, phase = (values.pop(f"ovality_{order}_{name}") for name in ("amplitude", "phase"))
        values[f"ovality_{order}"] = np.column_stack([amplitude, phase])
        values["pin_radial"] = values["pin_radial"] - oval_shift(amplitude, phase, order, values["pin_radial"].shape[1])
    return values


def assert_close(values, expected, name):
    np.testing.assert_allclose(values, expected, rtol=0, atol=1e-12, err_msg=name)


def test_groups_are_the_tolerances_that_vary():
    assert set(GROUPS) == {name for name in QUICK.tolerances.model_fields_set if name != "bearing_clearance"}
    fixed = Fixed(distribution="fixed", value_um=1.0)
    variant = QUICK.tolerances.model_copy(update={"ovality_2": fixed, "pin_radius": fixed})
    assert set(error_groups(study(variant))) == set(GROUPS) - {"pin_radius"}, "a fixed ovality varies by its phase"
    assert error_groups(study(Tolerances())) == ()


@pytest.mark.parametrize("nominal", [True, False])
def test_the_base_sets_are_samples_of_a_monte_carlo_study(nominal):
    whole = study(nominal_first=nominal)
    units, samples = draw_mixed(whole, 0, 2 * N), draw(whole, nominal, 2 * N + nominal)
    assert drawn_units(whole) == 2 * N
    assert drawn_units(study(count=30)) == 30
    assert drawn_units(study(experiment="sobol", count=4096)) == 0
    for field in fields(units):
        np.testing.assert_array_equal(getattr(units, field.name), getattr(samples, field.name))


def test_a_mixed_unit_has_one_group_of_the_other_set_and_the_rest_of_the_base():
    units = parts(draw_mixed(study(), 0, (2 + len(GROUPS)) * N))
    base, counterpart = ({name: values[k * N : (k + 1) * N] for name, values in units.items()} for k in (0, 1))
    for k, group in enumerate(GROUPS, 2):
        for name, values in units.items():
            mixed = values[k * N : (k + 1) * N]
            assert_close(mixed, (counterpart if name == group else base)[name], f"{name} where {group} is exchanged")
            if name in GROUPS:
                assert not np.any(
                    np.all(np.isclose(base[name].reshape(N, -1), counterpart[name].reshape(N, -1)), axis=1)
                )


def test_a_unit_is_the_same_in_any_division():
    whole = draw_mixed(study(), 0, 11 * N)
    for start, stop in ((0, 0), (3, 4), (N - 1, 2 * N + 1), (5 * N + 2, 11 * N)):
        part = draw_mixed(study(), start, stop)
        for field in fields(whole):
            np.testing.assert_array_equal(getattr(part, field.name), getattr(whole, field.name)[start:stop])


def test_groups_are_independent_and_elements_of_one_need_not_be():
    """Over 4,000 units no correlation between groups exceeds four standard errors; neighbouring seats' does."""
    large_case = study(count=4000, nominal_first=False)
    units = parts(draw(large_case, 0, 4000))
    angle = units["ovality_2"][:, 1]
    units["ovality_2"] = np.column_stack([units["ovality_2"][:, 0], np.cos(2 * angle), np.sin(2 * angle)])
    columns = {name: units[name].reshape(4000, -1)[:, :3] for name in GROUPS}
    for name, values in columns.items():
        for partner in set(GROUPS) - {name}:
            shared = np.corrcoef(values.T, columns[partner].T)[: values.shape[1], values.shape[1] :]
            assert np.max(np.abs(shared)) < 4.5 / np.sqrt(4000), (name, partner)
    assert np.corrcoef(columns["pin_radial"].T)[0, 1] > 0.3
