"""Variance-based indices of the paper's rigid backlash against brute force: conditional variances by double loops.

The double loop shares no code with the design or the estimator: it freezes a group in the errors themselves (not in the
unit cube), draws the others anew, and splits the variance by an analysis of variance.
"""

import tomllib
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline import assembly
from pipeline.config import load_design, load_study, parse_study
from pipeline.config.dimensions.pins import oval_shift
from pipeline.config.studies.study import Drivers
from pipeline.engine.runner import Resources, run
from pipeline.model.geometry.clearance import gaps
from pipeline.model.geometry.rigid_play.rigid_backlash import rigid_play
from pipeline.sampling.errors import draw
from pipeline.sampling.pick_freeze import draw_mixed, error_groups
from pipeline.statistics.sensitivity import variance_indices
from stages.chain import STAGES

CRANKS = 0.0, 90.0, 180.0, 270.0
ROOT = Path(__file__).parents[2]
STUDY = load_study("paper", ROOT)
REDUCERS = [assembly.reducer(STUDY.design, crank) for crank in CRANKS]
OVALS = {"ovality_2": 2, "ovality_3": 3}


def worst_backlash(sampled):
    """Largest rigid backlash over the crank angles (n,) [arcmin]."""
    errors, profile = assembly.errors(sampled), assembly.profile(STUDY.design)
    loose = np.zeros(len(sampled))
    plays = [
        rigid_play(reducer, gaps(profile, reducer, errors, **dict(STUDY.clearance)), loose).backlash
        for reducer in REDUCERS
    ]
    return np.degrees(np.max(plays, axis=0)) * 60


def rows(errors, index):
    return type(errors)(**{field.name: getattr(errors, field.name)[index] for field in fields(errors)})


def with_group(errors, donor, group):
    """``errors`` with one group's values from ``donor``; the pins' radial errors hold the ovalities' shift."""

    def shift(units, name):
        pins = units.pin_radial.shape[1]
        return oval_shift(getattr(units, f"{name}_amplitude"), getattr(units, f"{name}_phase"), OVALS[name], pins)

    if group in OVALS:
        names = f"{group}_amplitude", f"{group}_phase"
        radial = errors.pin_radial - shift(errors, group) + shift(donor, group)
        return replace(errors, pin_radial=radial, **{name: getattr(donor, name) for name in names})
    if group == "pin_radial":
        oval = sum(shift(errors, name) - shift(donor, name) for name in OVALS)
        return replace(errors, pin_radial=donor.pin_radial + oval)
    return replace(errors, **{group: getattr(donor, group)})


def split_variance(values):
    """Variance between and within the rows of ``values`` (n_outer, n_inner), both without bias."""
    variance_within = values.var(axis=1, ddof=1).mean()
    return values.mean(axis=1).var(ddof=1) - variance_within / values.shape[1], variance_within


def brute_force(group, outer, inner, rng):
    """First-order and total index of a group on the worst backlash, by two double loops."""
    pool = draw(STUDY, 1, STUDY.samples.rows)
    index = rng.integers(0, len(pool), (3, outer * inner))
    frozen = np.repeat(index[0, :outer], inner)
    isolated = worst_backlash(with_group(rows(pool, index[1]), rows(pool, frozen), group))
    remaining = worst_backlash(with_group(rows(pool, frozen), rows(pool, index[2]), group))
    step_value, tolerance_range = split_variance(isolated.reshape(outer, inner))
    _, vanishing = split_variance(remaining.reshape(outer, inner))
    return step_value / (step_value + tolerance_range), vanishing / (step_value + tolerance_range)


def by_pick_freeze(count):
    study = STUDY.model_copy(update={"drivers": Drivers(base_samples=count)})
    groups = error_groups(study)
    values = worst_backlash(draw_mixed(study, 0, (2 + len(groups)) * count)).reshape(-1, count)
    return groups, variance_indices(values[0], values[1], values[2:], 0.95)


@pytest.fixture(scope="module")
def estimated():
    return by_pick_freeze(400)


@pytest.mark.parametrize("group", ["ovality_2", "pin_radial", "pin_tangential", "disk_profile", "lobe_profile"])
def test_indices_of_the_rigid_backlash_are_those_of_a_double_loop(estimated, group):
    """Within the interval and two standard deviations of the double loop's own share."""
    groups, indices = estimated
    outer, inner, g = 200, 20, groups.index(group)
    for shares, truth in zip(
        (indices.first_order, indices.total), brute_force(group, outer, inner, np.random.default_rng(1)), strict=True
    ):
        half = (shares.ci_high[g] - shares.ci_low[g]) / 2
        assert abs(shares.value[g] - truth) < half + 2 * (truth + 1 / inner) * np.sqrt(2 / outer)
        assert half < 0.12


def test_a_tolerance_without_effect_has_no_share_where_finite_motions_add_to_the_play(new_runs):
    """The units of both sets have them: with a clearance of 0.1 mm they add 0.1 arcmin."""
    data = tomllib.loads((ROOT / "data/studies/printed_drive.toml").read_text(encoding="utf-8"))
    profile = {"distribution": "uniform", "lower_um": -3.0, "upper_um": 3.0, "allowance_um": 100.0}
    idle = {"distribution": "uniform", "lower_um": -0.01, "upper_um": 0.01}
    data |= {"tolerances": {"disk_profile": profile, "roller_diameter": idle}, "drivers": {"base_samples": 40}}
    data |= {"cycle": {"crank_deg": [0.0, 90.0], "rigid_angles": 3, "levels_per_branch": 0}, "limits": {}}
    data["samples"]["count"] = 80
    data["reduce"] = {**data.get("reduce", {}), "disk": "rigid"}
    for section in ("model_forms", "costs", "tails"):
        data.pop(section, None)
    study = parse_study(data, "idle", "idle.toml", lambda design: load_design(design, ROOT))
    outputs = run(STAGES, study, ["aggregate"], new_runs(), Resources(1, 100))
    table = pd.DataFrame(outputs["aggregate"].read("sensitivity"))
    rows = table.query("metric == 'clearance_backlash_arcmin' and over == 'worst' and kind == 'total'")
    shares = rows.set_index("parameter")["index"]
    assert shares["roller_diameter"] < 1e-3
    assert shares["disk_profile"] > 0.9
    assert np.max(np.abs(outputs["clearance"].read("kinematic")["finite_motion_arcmin"])) > 0.01


if __name__ == "__main__":  # the long form: python tests/verification/test_drivers_of_backlash.py
    names, long = by_pick_freeze(2000)
    for g, name in enumerate(names):
        double_loop = brute_force(name, 1000, 40, np.random.default_rng(g))
        for kind, truth in zip(("first_order", "total"), double_loop, strict=True):
            estimate = getattr(long, kind)
            interval = f"{estimate.value[g]:6.3f} {estimate.ci_low[g]:6.3f} {estimate.ci_high[g]:6.3f}"
            print(f"{name:16} {kind:12} {interval} {truth:6.3f}")
