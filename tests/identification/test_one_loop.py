"""One position with one loop, the commonest commercial test: fitted in sample, said so, with what to measure next."""

import re

import numpy as np
import pandas as pd
import pytest
from synthetic_unit import ROOT, Bench, make_unit

from pipeline.config import load_study
from pipeline.identification.identify import identify
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.identification.results.write import findings, write
from pipeline.identification.selection.statements.verdict import UNEXPLAINED
from pipeline.report.unit.page import write_page


@pytest.fixture(scope="module", params=[20, 50], ids=["sparse", "dense"])
def answer(request, tmp_path_factory, condensed):
    """Identification and page of one loop with friction, of so many rows a branch."""
    home = tmp_path_factory.mktemp("loop")
    bench = Bench(cranks=(0.0,), cycles=1, rows=request.param)
    identification = identify(
        load_measured_unit(make_unit(home / "u", {"coulomb": [0.5]}, bench, condensed), ROOT), condensed
    )
    findings_of_unit = findings(identification)
    written = write(findings_of_unit, home / "out")
    write_page(findings_of_unit, *written, home / "out", home / "out")
    return identification, home / "out"


@pytest.mark.long
def test_the_fit_is_in_sample_and_says_so(answer):
    result, folder = answer
    assert result.folds.in_sample
    assert result.folds.cells.all()
    np.testing.assert_array_equal(result.curves["recalibrated"], result.selection.base.fit.predicted_angle)
    page = re.sub(r"<[^>]*>", "", (folder / "report.html").read_text())
    for text in (result.statement.sentence, page):
        assert "in sample" in text
        assert "No data are left to test the fit" in text
    assert "held-out error" not in result.statement.sentence
    assert "two or more other crank angles" in result.statement.advice


@pytest.mark.long
def test_a_loop_that_replays_itself_is_no_baseline(answer):
    """Its error is none, or rounding: the page divided by it."""
    result, folder = answer
    assert result.baselines
    assert all(error.to_noise > 0.1 for error in result.baselines.values())
    assert "replay of the training" not in (folder / "report.html").read_text()


@pytest.mark.long
def test_nothing_is_claimed_of_one_loop_but_the_effect_describes_it(answer):
    result, _ = answer
    assert result.verdict.named_effects == ()
    if len(result.measurement.rows) > 100:  # 60 rows do not resolve the corners of the loop
        assert result.verdict.verdict == UNEXPLAINED
        assert "friction" in result.statement.sentence
        assert "cannot confirm it" in result.statement.sentence


@pytest.mark.long
def test_signatures_of_one_loop_have_values(answer):
    """Friction of 0.5 N m holds each branch back by its angle of the slope; the refit leaves it in the residual."""
    _, folder = answer
    signatures = pd.read_parquet(folder / "signatures.parquet").set_index(["of", "signature"])
    half = signatures.loc[("recalibrated", "branch_half_difference")]
    assert half["value"] > 0.02
    assert np.isfinite(signatures.loc[("recalibrated", "play"), "value"])


@pytest.mark.long
def test_the_best_description_can_be_run_and_says_that_it_is_no_claim(answer):
    result, folder = answer
    best = folder / "best-u.toml"
    assert best.exists() == (result.verdict.verdict == UNEXPLAINED and result.selection.best_model != "")
    if best.exists():
        design = load_study(best, ROOT).design
        assert design.effects
        assert "Not claimed" in (folder / "best-design.toml").read_text()
        assert all(
            "NOT CLAIMED" in design.provenance[f"effects.{name}.{p}"].reason
            for name, values in design.effects.items()
            for p in values
        )
        assert "best-u.toml" in (folder / "report.html").read_text()
