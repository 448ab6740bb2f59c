"""Costs of tolerances by grades of ISO 286: the widths of the standard, the maker's numbers, and what is refused."""

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from pipeline.config.studies.costs import AnyCost

READ = TypeAdapter(AnyCost).validate_python


def graded(**settings):
    return READ({"law": "iso_grade", "cost": 2.0, "grade": 5, "size_mm": 4.0, **settings})


def test_the_example_steps_by_preferred_numbers() -> None:
    """Sizes above 3 up to 6 mm: IT4 4, IT5 5, IT6 8, IT7 12 um; each grade a fifth of a decade of cost."""
    cost = graded()
    assert cost.example
    np.testing.assert_allclose(cost.of_one(np.array([4.0, 5.0, 8.0, 12.0])), 2.0 * 10 ** (np.array([1, 0, -1, -2]) / 5))
    step_value = float(cost.of_one(np.array(np.sqrt(5.0 * 8.0))))
    assert step_value == pytest.approx(2.0 * 10**-0.1)  # straight in the logarithms
    assert np.isnan(cost.of_one(np.array(1.0)))
    assert cost.widths_um == (2.5, 75.0)


def test_a_radius_has_half_the_zone_of_its_diameter() -> None:
    widths = np.array([4.0, 8.0, 12.0])
    np.testing.assert_allclose(graded(of="radius").of_one(widths / 2), graded().of_one(widths))


def test_the_makers_own_grades_stand() -> None:
    cost = graded(relative_costs={"4": 9.0, "5": 3.0, "7": 1.5})
    assert not cost.example
    np.testing.assert_allclose(cost.of_one(np.array([4.0, 5.0, 12.0])), [6.0, 2.0, 1.0])
    assert cost.widths_um == (4.0, 12.0)
    assert list(cost.problems("costs.pin_radius")) == []


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"relative_costs": {"5": 1.0, "15": 0.5}}, "two or more of the grades 3 to 11"),
        ({"relative_costs": {"5": 1.0, "6": 2.0}}, "must descend"),
        ({"relative_costs": {"6": 2.0, "7": 1.0}}, "must lie among"),
    ],
)
def test_grades_that_contradict_themselves_are_named(settings: dict, message: str) -> None:
    (problem,) = graded(**settings).problems("costs.pin_radius")
    assert message in problem.requirement


def test_a_grade_that_the_standard_lacks_is_refused() -> None:
    with pytest.raises(ValidationError, match="grade"):
        graded(grade=2)
