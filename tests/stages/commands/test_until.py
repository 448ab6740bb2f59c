"""A study that goes on until its yield is known: where it ends, what its rows are, and what it does when killed."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from small_study import small_study

from pipeline import settings
from pipeline.config import Study
from pipeline.config.studies.study import Until
from pipeline.engine import runner
from pipeline.errors import InputError
from pipeline.library import running, studies
from pipeline.report.results import needed_units
from pipeline.report.sections.further import SamplesSection
from pipeline.statistics.intervals import next_units

BATCH, HALF_WIDTH = 8, 0.16


def until(**changes: object) -> Study:
    """Of rigid disks at one crank angle; its limit is one that some units break."""
    study = small_study(until=Until(**{"yield_half_width": HALF_WIDTH} | changes))
    limits = study.limits.model_copy(update={"clearance_backlash_arcmin": 2.1})
    changed = {"reduce": study.reduce.model_copy(update={"disk": "rigid"}), "limits": limits, "name": "until"}
    changed["cycle"] = study.cycle.model_copy(update={"crank_deg": (0.0,), "rigid_angles": 7})
    return study.model_copy(update=changed)


@pytest.fixture
def own_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(settings, "RUNS", tmp_path / "runs")
    return tmp_path / "runs"


def half_width(kept_items: np.ndarray) -> float:
    """Of the exact interval of a share, by the beta distribution."""
    n, k = len(kept_items), int(kept_items.sum())
    low = stats.beta(k, n - k + 1).ppf(0.025) if k else 0.0
    high = stats.beta(k + 1, n - k).ppf(0.975) if k < n else 1.0
    return (high - low) / 2


def kept(units: pd.DataFrame, study: Study) -> np.ndarray:
    limits = study.limits
    return (
        (units["clearance_backlash_arcmin_worst"] <= limits.clearance_backlash_arcmin)
        & (units["lost_motion_arcmin_worst"] <= limits.lost_motion_arcmin)
        & (units["torsional_rigidity_Nm_per_arcmin_worst"] >= limits.torsional_rigidity_Nm_per_arcmin)
        & (units["peak_pressure_MPa_worst"] <= limits.peak_pressure_MPa)
    ).to_numpy()


@pytest.mark.long
def test_it_ends_where_the_yield_is_known_with_the_rows_of_one_run(
    own_runs: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """Killed in a batch it goes on there; what it leaves is what one run of its size leaves, value for value."""
    original_run, sizes = runner.run, []

    def killed(stages, study, targets, *remainder):
        sizes.append(study.samples.count)
        if len(sizes) == 2:
            raise KeyboardInterrupt
        return original_run(stages, study, targets, *remainder)

    monkeypatch.setattr(runner, "run", killed)
    with pytest.raises(KeyboardInterrupt):
        studies.run(until(), ["aggregate"], jobs=1)
    assert running.known_size(until()).samples.count == sizes[1]
    outputs = studies.run(until(), ["aggregate"], jobs=1)
    assert sizes[2] == sizes[1]  # the first batch was not run again
    n = outputs.study.samples.count
    passes = kept(outputs.units, outputs.study)
    assert len(passes) == n
    assert n % BATCH == 0
    assert half_width(passes) <= HALF_WIDTH
    assert all(half_width(passes[:size]) > HALF_WIDTH for size in {*sizes} - {n})

    reference = outputs.study.samples.model_copy(update={"until": None})
    single_change = studies.run(
        until().model_copy(update={"name": "plain", "samples": reference}), ["aggregate"], jobs=1
    )
    for stage, output in single_change.outputs.items():
        assert output.hashes == outputs.outputs[stage].hashes, stage
    table = outputs.table("aggregate/sample_convergence")
    message = table[table["metric"] == "all_limits"]
    assert message["n"].iloc[-1] == n
    for row in message.itertuples():
        assert row.value == pytest.approx(passes[: row.n].mean())
        assert (row.ci_high - row.ci_low) / 2 == pytest.approx(half_width(passes[: row.n]))
    n_looks = len(sizes)
    studies.run(until(), ["aggregate"], jobs=1)
    assert len(sizes) == n_looks + 1  # up to date: no batch is asked again
    assert "yield" in capsys.readouterr().err


@pytest.mark.long
def test_it_ends_at_the_most_that_it_may_take_and_says_so(own_runs: Path) -> None:
    outputs = studies.run(until(at_most=11, yield_half_width=0.1), ["aggregate"], jobs=1)
    assert outputs.study.samples.count == 11
    frames = SimpleNamespace(
        study=outputs.study, turn_statistic="worst", distributions=outputs.table("aggregate/distributions")
    )
    section = SamplesSection(frames)
    assert "ended at 11 samples, the largest number allowed" in section.end_sentence
    assert section.share is not None
    width, units = needed_units(section.share, 0.95)[1]
    assert (f"±{100 * width:g} %", f"{units:,}") in section.rows


def test_a_setting_that_cannot_end_is_refused(tmp_path: Path) -> None:
    text = (settings.ROOT / "data/studies/quick.toml").read_text()
    until_line = "until = { yield_half_width = 0.005, at_most = 100000 }\n"
    cases = {
        "[limits] sets no limit": text[: text.index("[limits]")] + text[text.index("[run]") :],
        "must be >= samples.count = 50": text,
        'must be "monte_carlo"': text.replace('"monte_carlo"', '"sobol"').replace("count = 50", "count = 56"),
    }
    for message, content in cases.items():
        line = until_line.replace("100000", "10") if "count" in message else until_line
        file = tmp_path / "study.toml"
        file.write_text(content.replace("[samples]\n", f"[samples]\n{line}"))
        with pytest.raises(InputError, match=message.replace("[", r"\[").replace("]", r"\]")):
            studies.load_study(file)


@pytest.mark.attack
def test_looking_several_times_costs_little_of_the_confidence() -> None:
    """Coverage of the interval at which a study ends, over 2,000 studies of a coin, against its nominal 95 %."""
    rng = np.random.default_rng(20261122)
    covered = []
    for share, half in ((0.8, 0.03), (0.98, 0.015)):
        for _ in range(1000):
            coins, n = rng.random(60_000) < share, 100
            while half_width(coins[:n]) > half:
                n = -(-next_units(float(coins[:n].mean()), n, n, half, 0.95) // 100) * 100
            k = int(coins[:n].sum())
            test = stats.binomtest(k, n).proportion_ci(0.95)
            covered.append(test.low <= share <= test.high)
    assert 0.93 < np.mean(covered) < 0.99


@pytest.mark.long
def test_what_is_remembered_belongs_to_the_settings(own_runs: Path) -> None:
    studies.run(until(at_most=BATCH), ["aggregate"], jobs=1)
    assert running.known_size(until(at_most=50)).samples.count > BATCH  # the same batch, whatever is to come of it
    variant = until().model_copy(update={"samples": until().samples.model_copy(update={"seed": 5})})
    assert running.known_size(variant).samples.count == BATCH
