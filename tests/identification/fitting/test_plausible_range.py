"""Plausible ranges of calibrated numbers: stated ones, and those of their kind."""

import tomllib

import pytest
from synthetic_unit import ROOT

from pipeline.config import load_design
from pipeline.config.changing import toml_of
from pipeline.config.designs.design import DIMENSION, METAL_MODULUS, STIFFNESS, plausible_range
from pipeline.config.reading import parse_design
from pipeline.errors import InputError

PAPER = load_design("pham2017", ROOT)
KEY = "output.roller_length_mm"


def with_range(low, high):
    raw = PAPER.model_dump()
    raw["provenance"][KEY]["plausible"] = [low, high]
    return parse_design(raw, "d.toml")


def test_stated_range_holds_in_the_unit_of_the_number():
    range_found = plausible_range(with_range(2.0, 3.0), KEY)
    assert (range_found.low, range_found.high) == pytest.approx((2.0 / 2.584, 3.0 / 2.584))
    assert "stated" in range_found.reason


@pytest.mark.parametrize(
    ("key", "factor"),
    [
        ("output.outer_station_mm", DIMENSION),
        ("bearing.stiffness_N_per_mm_power", STIFFNESS),
        ("materials.steel.youngs_modulus_MPa", METAL_MODULUS),
    ],
)
def test_a_number_without_a_stated_range_has_that_of_its_kind(key, factor):
    range_found = plausible_range(PAPER, key)
    assert (range_found.low, range_found.high) == pytest.approx((1 / factor, factor))


def test_what_was_silent_before_is_outside_of_its_range():
    """The refits of the issue: bearing x 11.4, roller length x 0.52, a station beyond the rim, a modulus x 0.05."""
    rim = 30.9 / PAPER.output.outer_station_mm
    of_issue = {"bearing.stiffness_N_per_mm_power": 11.4, KEY: 0.52, "output.outer_station_mm": rim}
    for key, factor in {**of_issue, "materials.steel.youngs_modulus_MPa": 0.05}.items():
        range_found = plausible_range(PAPER, key)
        assert not range_found.low < factor < range_found.high


@pytest.mark.parametrize("pair", [(2.6, 3.0), (2.0, 2.5), (3.0, 2.0)])
def test_a_range_that_does_not_hold_its_number_is_refused(pair):
    with pytest.raises(InputError, match=rf'provenance."{KEY}".plausible.*about the number itself, 2.584'):
        with_range(*pair)


def test_a_design_without_a_stated_range_is_written_without_one():
    text = toml_of(with_range(2.0, 3.0).model_dump())
    assert text.count("plausible = ") == 1
    assert parse_design(tomllib.loads(text), "d.toml").provenance[KEY].plausible == (2.0, 3.0)
