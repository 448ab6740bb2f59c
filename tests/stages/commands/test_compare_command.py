"""The command compare: studies that differ in one tolerance, unit by unit; without shared draws; of cases."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline import cli, settings
from pipeline.config import load_study
from pipeline.decisions.run_comparison import ComparedRun, differences, differing_inputs, shared_draws
from pipeline.model.metrics import library as metric_library
from pipeline.report.decisions.compare import metric_answers, warnings, yield_sentence
from pipeline.statistics.differences import share_difference

ROOT = Path(__file__).parent.parent.parent.parent
QUICK = (ROOT / "data/studies/quick.toml").read_text().replace("count = 50", "count = 24")
QUICK = QUICK.replace("levels_per_branch", "rigid_angles = 7\nlevels_per_branch")
ECCENTRICITY = (
    '[tolerances.eccentricity]          # ground crank\ndistribution = "normal"\nlower_um = -2.0\nupper_um = 2.0'
)


@pytest.fixture
def own_runs(new_runs: Callable[[], Path], monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = new_runs()
    monkeypatch.setattr(settings, "RUNS", folder)
    return folder


def written(folder: Path, name: str, text: str) -> str:
    path = folder / f"{name}.toml"
    path.write_text(text)
    return str(path)


def compared(own_runs: Path, a: str, b: str) -> pd.DataFrame:
    assert cli.main(["compare", a, b, "--jobs", "1"]) == 0
    folder = own_runs / "compare" / f"{Path(a).stem}-{Path(b).stem}"
    table = pd.read_parquet(folder / "differences.parquet")
    pd.testing.assert_frame_equal(
        pd.read_csv(folder / "differences.csv"),
        table.astype({"metric": str, "statistic": str}),
        check_dtype=False,
        rtol=1e-6,
    )
    return table.set_index(["metric", "statistic"])


@pytest.mark.long
def test_one_tolerance_changed_is_compared_unit_by_unit(
    outputs: dict, own_runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    assert ECCENTRICITY in QUICK
    wide = QUICK.replace(ECCENTRICITY, ECCENTRICITY.replace("2.0", "6.0"))
    a, b = written(tmp_path, "narrow", QUICK), written(tmp_path, "wide", wide)
    table = compared(own_runs, a, b)
    units = [pd.read_parquet(own_runs / name / "aggregate/units.parquet").iloc[1:] for name in ("narrow", "wide")]
    lost_motion = [frame["lost_motion_arcmin_worst"].to_numpy() for frame in units]
    row = table.loc["lost_motion_arcmin", "mean"]
    assert row["paired"]
    assert row["difference"] == pytest.approx(np.mean(lost_motion[1] - lost_motion[0]))
    half = (
        2.0687 * np.std(lost_motion[1] - lost_motion[0], ddof=1) / np.sqrt(24)
    )  # Student's t of 23 degrees of freedom
    assert row["ci_high"] - row["difference"] == pytest.approx(half, rel=1e-4)
    kept_items = [np.mean(values <= 2.8) for values in lost_motion]
    assert table.loc["lost_motion_arcmin", "yield"]["difference"] == pytest.approx(kept_items[1] - kept_items[0])
    page = (own_runs / "compare/narrow-wide/report.html").read_text()
    assert "tolerances.eccentricity.upper_um" in page
    assert "share their random numbers" in page
    assert "report.html" in capsys.readouterr().out
    inputs = pd.read_csv(own_runs / "compare/narrow-wide/inputs.csv")
    assert set(inputs["key"]) == {"tolerances.eccentricity.lower_um", "tolerances.eccentricity.upper_um"}


def test_studies_that_share_no_draw_are_told_apart() -> None:
    quick, paper, holes = (load_study(name, ROOT) for name in ("quick", "paper", "pin_in_hole"))
    seeded = quick.model_copy(update={"samples": quick.samples.model_copy(update={"seed": 1})})
    assert shared_draws(quick, paper) == 50
    assert shared_draws(quick, seeded) == shared_draws(quick, holes) == 0
    assert [key for key, *_ in differing_inputs(quick, seeded)] == ["samples.seed"]
    sobol = {"experiment": "sobol", "count": 64}
    pair = [
        quick.model_copy(update={"samples": quick.samples.model_copy(update=sobol | {"randomisations": r})})
        for r in (8, 16)
    ]
    assert shared_draws(pair[0], pair[0]) == 64
    assert shared_draws(*pair) == 0


@pytest.mark.long
def test_cases_are_compared_by_their_labels(outputs: dict, own_runs: Path, tmp_path: Path) -> None:
    head, remainder = QUICK.split("[samples]")[0], QUICK[QUICK.index("# --- how it is computed") :]
    cycle = re.sub(
        r"keep_contacts = .*", "keep_contacts = [0]", QUICK[QUICK.index("[cycle]") : QUICK.index("# --- tolerances")]
    )
    listed_study = (
        f'{head}[samples]\nexperiment = "cases"\n\n[[cases]]\nlabel = "one"\ndisk_profile = SIZE\n\n{cycle}{remainder}'
    )
    a, b = (
        written(tmp_path, "tight", listed_study.replace("SIZE", "8.0")),
        written(tmp_path, "loose", listed_study.replace("SIZE", "12.0")),
    )
    table = compared(own_runs, a, b)
    row = table.loc["lost_motion_arcmin", "one"]
    assert row["difference"] == row["b"] - row["a"] > 0.1
    assert np.isnan(row["ci_low"])
    assert cli.main(["compare", a, written(tmp_path, "random", QUICK), "--jobs", "1"]) == 2


def of_runs(yield_a: float, yield_b: float, experiment: str, **samples: int) -> list[ComparedRun]:
    """Two runs of quick whose units have a lost motion of 2 arcmin, or 3 where they miss its limit of 2.8."""
    study = load_study("quick", ROOT)
    settings_of = study.samples.model_copy(update={"experiment": experiment, "nominal_first": False, **samples})
    study = study.model_copy(update={"samples": settings_of})
    order = np.random.default_rng(0).permutation(samples["count"])  # one order: the units that miss are shared
    runs = []
    for share in (yield_a, yield_b):
        units = pd.DataFrame(0.0, index=np.arange(samples["count"]), columns=list(metric_library()))
        units["lost_motion_arcmin"] = np.where(order < share * samples["count"], 2.0, 3.0)
        units["torsional_rigidity_Nm_per_arcmin"] = 6.0
        units["preloaded"] = False
        runs.append(ComparedRun(study, units, pd.DataFrame()))
    return runs


@pytest.mark.parametrize("experiment", ["sobol", "latin_hypercube"])
@pytest.mark.parametrize(("yields", "low", "high"), [((0.99, 0.98), -0.04, 0.0), ((0.9, 0.7), -0.3, -0.1)])
def test_yields_of_replicated_runs_have_intervals_also_where_few_units_differ(
    experiment: str, yields: tuple[float, float], low: float, high: float
) -> None:
    table = pd.DataFrame(differences(*of_runs(*yields, experiment, count=256, randomisations=8)))
    row = table.set_index(["metric", "statistic"]).loc[("lost_motion_arcmin", "yield")]
    assert row["difference"] == pytest.approx(yields[1] - yields[0], abs=0.005)
    assert low < row["ci_low"] < row["difference"] < row["ci_high"] < high + 0.01
    runs = of_runs(*yields, experiment, count=256, randomisations=8)
    passes = [run.units["lost_motion_arcmin"].to_numpy() < 2.8 for run in runs]
    newcombe = share_difference(*passes, 0.95, are_paired=True)
    assert ((row["ci_low"], row["ci_high"]) == pytest.approx(newcombe)) == (yields[0] == 0.99)


def test_a_part_of_the_units_and_another_way_of_measuring_are_said() -> None:
    """50 of 2,000 units that two runs share have a yield of their own, and a loop read at 6 % another lost motion."""
    whole, part = of_runs(0.9, 0.7, "monte_carlo", count=100)
    part = replace(part, units=part.units.iloc[:40])
    rows = pd.DataFrame(differences(whole, part))
    assert "Compared are the 40 units of the same draws" in yield_sentence(whole, part, rows)
    assert "of 100 in A and 40 in B" in yield_sentence(whole, part, rows)
    assert yield_sentence(whole, whole, pd.DataFrame(differences(whole, whole))).startswith("90.0 % of the units")
    assert not warnings(whole, part)
    (text,) = warnings(whole, replace(part, units=part.units.assign(preloaded=np.arange(40) < 10)))
    assert text.startswith("Warning: 0 % of the units of A are preloaded, of those of B 25 %: at some crank angle")
    otherwise = replace(part, study=part.study.with_section("metrics", lost_motion_percent=6.0))
    (text,) = warnings(whole, otherwise)
    assert "metrics.lost_motion_percent 3.0 in A, 6.0 in B" in text


def test_a_single_unit_has_a_mean_and_no_interval() -> None:
    whole, part = of_runs(0.9, 0.7, "monte_carlo", count=100)
    single = replace(part, units=part.units.iloc[:1])
    answers = metric_answers(whole, single, pd.DataFrame(differences(whole, single)))
    assert answers
    assert all("interval )" not in answer["text"] for answer in answers)
