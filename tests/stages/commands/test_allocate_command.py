"""The command allocate: cheaper than scaling alike, confirmed by fresh units, and a study file that runs."""

import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from pipeline import cli, settings
from pipeline.config import load_study
from pipeline.config.studies.study import ALL_LIMITS
from pipeline.decisions.allocation import Choice
from pipeline.decisions.allocation_search import Search
from pipeline.decisions.cheapest import LinearUnits
from pipeline.decisions.fresh_units import PRELOADED, WITHOUT_RESULT, yields
from pipeline.report.decisions.bounds import more_preload_sentence, sentence
from pipeline.statistics.intervals import Estimate, pass_share

ROOT = Path(__file__).parent.parent.parent.parent
QUICK = (ROOT / "data/studies/quick.toml").read_text().replace("crank_deg = [0.0, 90.0]", "crank_deg = [0.0]")
QUICK = QUICK.replace("levels_per_branch", "rigid_angles = 3\nlevels_per_branch")
COSTS = """
[costs.pin_tangential]
law = "reciprocal"
cost = 4.0
tolerance_um = 6.0

[costs.eccentricity]
law = "power"
exponent = 0.5
cost = 1.0
tolerance_um = 4.0

[costs.roller_diameter]
law = "table"
tolerances_um = [1.0, 2.0, 4.0]
costs = [0.1, 0.05, 0.02]
per = "element"
"""


@pytest.fixture
def own_runs(new_runs: Callable[[], Path], monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = new_runs()
    monkeypatch.setattr(settings, "RUNS", folder)
    return folder


def written(folder: Path, text: str) -> str:
    path = folder / "priced.toml"
    path.write_text(text)
    return str(path)


def test_units_without_a_result_fail_where_tolerances_are_chosen_and_are_said():
    """Else tolerances so loose that the model is not valid for most units would have the yield of the others."""
    study = load_study("quick", ROOT)
    values = {name: np.full(40, 0.5 * limit) for name, limit in study.limits.of_metrics.items()}
    values["torsional_rigidity_Nm_per_arcmin"] = np.full(40, 1e3)
    values["lost_motion_arcmin"][10:] = np.nan
    known, all_units = (yields(study, values, missing_fail)[ALL_LIMITS] for missing_fail in (False, True))
    assert (known.value, known.n) == (1.0, 10)
    assert known.ci_low < 0.25 == all_units.value
    check = {ALL_LIMITS: all_units, PRELOADED: pass_share(np.zeros(40, bool), 0.95)}
    check[WITHOUT_RESULT] = pass_share(np.isnan(values["lost_motion_arcmin"]), 0.95)
    choice = Choice(np.ones(1), 1.0, check)
    answer = SimpleNamespace(
        study=study, stated_choice=choice, cheapest=choice, reaches_target=False, target=0.9, hardest_limit="one"
    )
    assert "40 new units, 75.0 % of them without a result, which count as failed" in sentence(answer)


@pytest.mark.parametrize(
    ("found", "alike", "words"),
    [
        ((0.98, 1.0), (0.97, 1.25), "the allocation is 20.0 % cheaper."),
        ((0.98, 1.0), (0.97, 0.8), "the allocation is 25.0 % dearer."),
        ((0.98, 1.0), (0.93, 0.8), "by these checks scaling alike misses the target."),
        ((0.94, 0.7), (0.97, 1.0), "by these checks the tolerances found miss the target."),
    ],
)
def test_costs_are_compared_of_tolerances_that_both_reach_the_target(
    found: tuple[float, float], alike: tuple[float, float], words: str
) -> None:
    choices = []
    for value, cost in (found, alike):
        check = {ALL_LIMITS: Estimate(value, value - 0.01, value + 0.01, 600), PRELOADED: share(0.0)}
        choices.append(Choice(np.ones(1), cost, {**check, WITHOUT_RESULT: share(0.0)}))
    answer = SimpleNamespace(
        study=load_study("quick", ROOT), stated_choice=choices[0], cheapest=choices[0], equal=choices[1], target=0.95
    )
    answer.reaches_target = True
    assert sentence(answer).endswith(words)


@pytest.mark.long
def test_an_allocation_is_cheaper_than_scaling_alike_and_runs(
    outputs: dict, own_runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    trials: list[LinearUnits] = []
    linear = Search.linear
    monkeypatch.setattr(Search, "linear", lambda *arguments: trials.append(linear(*arguments)) or trials[-1])
    study = written(tmp_path, re.sub(r"backlash_arcmin = \S+", "backlash_arcmin = 2.25", QUICK) + COSTS)
    assert cli.main(["allocate", "--study", study, "--yield", "0.85", "--units", "200", "--jobs", "1"]) == 0
    told = capsys.readouterr()
    assert "cheaper" in told.out
    for progress in ("allocate  round 1: yield ", "allocate  check: yield ", "200 units) at cost "):
        assert progress in told.err, "a search takes minutes where units are slow"
    for units in trials:
        np.testing.assert_allclose(units.value.std(axis=0), 1.0, rtol=0.05)  # badness is in spreads of its metric
    folder = own_runs / "allocate" / "priced"
    table = pd.read_parquet(folder / "allocation.parquet").set_index("dimension")
    check = pd.read_csv(folder / "check.csv").set_index(["tolerances", "metric"])
    result, equal = (check.loc[name, "all_limits"] for name in ("found", "equal"))
    assert result["ci_high"] > 0.85
    assert result["cost"] < equal["cost"]
    # costs by hand: 40 elements of a table straight in the logarithms
    rollers = 40 * np.exp(
        np.interp(np.log(table["width_um"]["roller_diameter"]), np.log([1, 2, 4]), np.log([0.1, 0.05, 0.02]))
    )
    zones = table["width_um"]
    by_hand = {
        "pin_tangential": 24 / zones["pin_tangential"],
        "eccentricity": 2 / np.sqrt(zones["eccentricity"]),
        "roller_diameter": rollers,
    }
    for name, cost in by_hand.items():
        assert table["cost"][name] == pytest.approx(cost, rel=1e-4)
    assert result["cost"] == pytest.approx(sum(by_hand.values()), rel=1e-4)
    allocated_study = load_study(str(folder / "allocated-priced.toml"), ROOT)
    assert allocated_study.tolerances.eccentricity.upper_um == pytest.approx(table["upper_um"]["eccentricity"])
    assert allocated_study.tolerances.pin_radial == load_study(study, ROOT).tolerances.pin_radial
    assert allocated_study.design == load_study(study, ROOT).design
    page = (folder / "report.html").read_text()
    assert "no cost is stated" in page
    shares = check["preloaded"].groupby("tolerances").unique()
    assert all(len(of_choice) == 1 for of_choice in shares)
    told_cells = "".join(page.split())
    assert [cell for (value,) in shares if (cell := f'<tdclass="n">{100 * value:.1f}%</td>') not in told_cells] == []


def share(value: float, units: int = 4000) -> Estimate:
    return pass_share(np.arange(units) < round(value * units), 0.95)


@pytest.mark.parametrize(
    ("before", "found", "units", "is_more"),
    [(0.1, 0.4, 4000, True), (0.1, 0.102, 4000, False), (0.4, 0.1, 4000, False), (0.0, 0.0, 4000, False)]
    + [(0.0, 0.02, 50, False), (0.0, 0.02, 4000, True)],
)
def test_more_preloaded_units_than_before_are_said(before: float, found: float, units: int, is_more: bool) -> None:
    """Beyond what as many units leave open, and only then."""
    other_shares = {ALL_LIMITS: share(0.9), WITHOUT_RESULT: share(0.0)}
    checks = [{**other_shares, PRELOADED: share(value, units)} for value in (before, found)]
    choices = [Choice(np.ones(1), 1.0, check) for check in checks]
    allocation = SimpleNamespace(study=load_study("quick", ROOT), stated_choice=choices[0], cheapest=choices[1])
    text = more_preload_sentence(allocation)
    assert bool(text) == is_more
    shares = (
        f"{100 * found:.3g} % of the units with the cheapest tolerances found are preloaded, of those with the "
        f"tolerances of the study {100 * before:.3g} %"
    )
    assert (shares in text) == is_more
    for reaches_target in (True, False):  # it is part of the answer, on the page and in the terminal
        values = {"reaches_target": reaches_target, "target": 0.9, "equal": None, "hardest_limit": "lost motion"}
        assert (shares in sentence(SimpleNamespace(**vars(allocation), **values))) == is_more


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        (QUICK, [], "no tolerance that varies has a cost"),
        (QUICK + COSTS.replace("[1.0, 2.0, 4.0]", "[1.0, 4.0, 2.0]"), [], "must ascend"),
        (QUICK + COSTS.replace("costs = [0.1, 0.05", "costs = [0.1, 0.15"), [], "must descend"),
        (QUICK + COSTS, ["--yield", "99"], "--yield = 99"),
        (QUICK + COSTS, ["--yield", "0.999", "--units", "100"], "at least 20000"),
    ],
)
def test_what_cannot_be_allocated_is_said(
    tmp_path: Path, text: str, options: list[str], words: str, capsys: pytest.CaptureFixture
) -> None:
    assert cli.main(["allocate", "--study", written(tmp_path, text), *options]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.long
def test_a_yield_that_is_not_reached_leaves_the_best_tolerances_and_says_so(
    outputs: dict, own_runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    text = re.sub(r"backlash_arcmin = \S+", "backlash_arcmin = 1.2", QUICK) + COSTS.split("[costs.ecc")[0]
    study = written(tmp_path, text)
    assert cli.main(["allocate", "--study", study, "--yield", "0.8", "--units", "100", "--jobs", "1"]) == 0
    told = capsys.readouterr()
    assert "The target of 80.0 % is not reached. The best tolerances found give " in told.out
    assert "Most failing units break clearance_backlash_arcmin = 1.2: loosen this limit" in told.out
    folder = own_runs / "allocate" / "priced"
    check = pd.read_csv(folder / "check.csv").set_index(["tolerances", "metric"])
    assert check.loc[("before", "all_limits"), "yield"] <= check.loc[("found", "all_limits"), "yield"] < 0.8
    assert load_study(str(folder / "allocated-priced.toml"), ROOT).tolerances.pin_tangential.upper_um != 3.0
    assert len(pd.read_csv(folder / "tradeoff.csv")) > 3
    assert "is not reached" in (folder / "report.html").read_text()
