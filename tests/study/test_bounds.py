"""Sizes that no part has are refused, with what is allowed; sizes at the edge of what is built are not."""

import copy
import tomllib
from pathlib import Path

import pytest

from pipeline.config import load_design, parse_design, parse_study
from pipeline.errors import InputError

ROOT = Path(__file__).parents[2]
DESIGN = tomllib.loads((ROOT / "data/designs/pham2017.toml").read_text())
STUDY = tomllib.loads((ROOT / "data/studies/quick.toml").read_text())


def changed(data, key, value):
    data = copy.deepcopy(data)
    *sections, name = key.split(".")
    table = data
    for section in sections:
        table = table.setdefault(section, {})
    table[name] = value
    return data


@pytest.mark.parametrize(
    ("key", "value", "allowed"),
    [
        ("disk.thickness_mm", 1e12, "must be <= 10000"),
        ("disk.thickness_mm", 5e-324, "must be >= 0.001"),
        ("bearing.exponent", 1e308, "must be <= 3"),
        ("bearing.stiffness_N_per_mm_power", 1e300, "must be <= 1e+12"),
        ("bearing.clearance_um", 1e9, "must be <= 1000"),
        ("cycloid.rated_torque_Nm", 1e308, "must be <= 1e+07"),
        ("cycloid.pins", 10**9, "must be <= 1000"),
        ("output.rollers", 8 * 10**9, "must be <= 800"),
        ("materials.steel.youngs_modulus_MPa", 5e-324, "must be >= 1"),
        ("effects.coulomb.torque_Nm", 1e30, "must be 0 to 1e+07 N m"),
        ("effects.coulomb.torque_Nm", -1.0, "must be 0 to 1e+07 N m"),
        ("effects.flank_wear.depth_um", 1e6, "must be -1000 to 1000 um"),
    ],
)
def test_a_size_that_no_part_has_is_refused(key, value, allowed):
    with pytest.raises(InputError) as error:
        parse_design(changed(DESIGN, key, value), "d.toml")
    assert any(line.startswith(f"d.toml: {key} = ") and allowed in line for line in error.value.problems)


@pytest.mark.parametrize(
    ("key", "value", "allowed"),
    [
        ("reduce.patch_half_width_mm", 5e-324, "must be >= 0.001"),
        ("reduce.largest_edge_mm", 0.002, "triangles, must be <= 2e+06"),
        ("reduce.growth", 5e-324, "must be >= 0.01"),
        ("samples.count", 10**9, "with 120 contacts a unit must be <= 83333333"),
        ("run.chunk", 10**30, "must be <= 1e+09"),
        ("tolerances.pin_radial.sigma_um", 1e300, "must be <= 1000"),
        ("tolerances.pin_radial.correlation_length_mm", 1e300, "must be <= 10000"),
    ],
)
def test_a_study_beyond_any_machine_is_refused(key, value, allowed):
    with pytest.raises(InputError) as error:
        parse_study(changed(STUDY, key, value), "s", "s.toml", lambda name: load_design(name, ROOT))
    assert any(line.startswith(f"s.toml: {key} = ") and allowed in line for line in error.value.problems)


@pytest.mark.parametrize(
    ("key", "value", "setting"),
    [
        ("bearing.stiffness_N_per_mm_power", 1e12, lambda design: design.bearing.stiffness_N_per_mm_power),
        ("disk.thickness_mm", 0.001, lambda design: design.disk.thickness_mm),
        ("effects.coulomb.torque_Nm", 0.0, lambda design: design.effects["coulomb"]["torque_Nm"]),
        ("bearing.exponent", 1.5, lambda design: design.bearing.exponent),
    ],
)
def test_sizes_at_the_edge_of_what_is_built_are_accepted(key, value, setting):
    """A bearing that is as good as rigid, a disk as thin as foil, a coulomb friction of nothing."""
    assert setting(parse_design(changed(DESIGN, key, value), "d.toml")) == value
