"""The drivers of the worst over the whole turn: by the search of a part of the units, and of all of them."""

import shutil
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.config import Study, load_design, parse_study
from pipeline.engine.runner import Resources, run
from pipeline.sampling.pick_freeze import error_groups
from stages import drivers
from stages.chain import STAGES
from stages.tables.sensitivity import worse_of_two

ROOT = Path(__file__).parents[2]
N = 76
METRICS = ("clearance_backlash_arcmin", "lost_motion_arcmin", "torsional_rigidity_Nm_per_arcmin", "peak_pressure_MPa")


def turn_study(name: str) -> Study:
    """The printed drive of rigid bodies, 14 pins: 182 pitches, eleven angles of the study, three of its tolerances."""
    data = tomllib.loads((ROOT / "data/studies/printed_drive.toml").read_text(encoding="utf-8"))
    data["samples"]["count"] = 2 * N
    data["cycle"] = {"levels_per_branch": 0, "curve_angles": 1, "audited_units": 10, "loaded_angles": 11}
    data["cycle"]["rigid_angles"] = 11
    data["reduce"] |= {"disk": "rigid"}
    data["drivers"] = {"base_samples": N}
    data["tolerances"] = {name: data["tolerances"][name] for name in ("disk_profile", "pin_radial", "roller_diameter")}
    return parse_study(data, name, f"{name}.toml", lambda design: load_design(design, ROOT))


def tables(study: Study, folder: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Units of the drivers, and the indices of the worst."""
    outputs = run(STAGES, study, ["aggregate"], folder, Resources(1, 200))
    units, indices = (
        pd.DataFrame(dict(outputs[stage].read(name)))
        for stage, name in (("drivers", "units"), ("aggregate", "sensitivity"))
    )
    shares = indices[(indices["over"] == "worst") & (indices["kind"] != "rank_correlation")]
    return units, shares.set_index(["metric", "kind", "parameter"])


@pytest.fixture(scope="module")
def runs(new_runs) -> dict[str, tuple[pd.DataFrame, pd.DataFrame]]:
    """Both of one run, whose stages before the drivers are run once."""
    folder, found = new_runs(), {}
    with pytest.MonkeyPatch.context() as patch:
        for name, share in (("part", 0.4), ("all", 1.0)):
            patch.setattr(drivers, "SEARCHED_SHARE", share)
            found[name] = tables(turn_study("turned"), folder)
            for stage in ("drivers", "aggregate"):
                shutil.rmtree(folder / "turned" / stage)
    return found


@pytest.mark.long
def test_the_first_base_samples_of_each_set_are_searched(runs) -> None:
    (part, _), (whole, _) = runs["part"], runs["all"]
    searched = part["base_sample"] < round(0.4 * N)
    for metric in METRICS:
        column = f"{metric}_found"
        assert (part[column].notna() == (searched & part[column].notna())).all()
        assert part.loc[searched, column].notna().mean() > 0.9
        np.testing.assert_allclose(part.loc[searched, column], whole.loc[searched, column], rtol=1e-3)
    assert len(part) == len(error_groups(turn_study("turned"))) * N
    assert (whole["lost_motion_arcmin_found"] > whole["lost_motion_arcmin_worst"]).mean() > 0.5


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.long
def test_indices_by_a_part_agree_with_those_of_all_units(runs, metric) -> None:
    """Within both intervals together, but for one in twenty; the part rests on as many rows as were searched."""
    part, whole = (runs[name][1].loc[metric].dropna(subset=["index"]) for name in ("part", "all"))
    assert len(part) == len(whole) > 4
    half = [0.5 * (table["ci_high"] - table["ci_low"]) for table in (part, whole)]
    apart = np.abs(part["index"] - whole["index"]) > np.hypot(*half)
    assert apart.mean() <= 0.1, part[apart]
    assert part["n"].max() <= round(0.4 * N) < whole["n"].min()


def test_the_worse_of_two_is_the_smaller_rigidity_and_the_larger_transmission_error():
    first, second = np.array([1.0, 3.0, np.nan]), np.array([2.0, 2.0, 2.0])
    np.testing.assert_equal(worse_of_two("torsional_rigidity_Nm_per_arcmin", first, second), [1.0, 2.0, np.nan])
    for name in ("lost_motion_arcmin", "transmission_error_arcsec"):
        np.testing.assert_equal(worse_of_two(name, first, second), [2.0, 3.0, np.nan])
