"""The verification suite in short, on a reducer of 20 pins: every limit of ``make verify``, its runner and its page.

``make verify`` runs the same checks at the paper's size and writes ``data/verification.md``.
"""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline import cli, settings
from pipeline.checks.calculix.deck import calculix_deck
from pipeline.checks.calculix.program import calculix_program, run_calculix
from pipeline.checks.specimen import (
    Finding,
    Specimen,
    at_least,
    largest_difference,
    loaded_equilibria,
    positive,
    reported_number,
    skipped_check,
)
from pipeline.checks.verify import CHECKS, elasticity, laws, page, run_checks, suite, whole
from pipeline.checks.verify.suite import COLUMNS, PAGE, CheckRow, write_results
from pipeline.config import load_study
from pipeline.errors import InputError

ROOT = Path(__file__).parents[2]
CRUDE = {"flank_edges_per_lobe": 20, "growth": 0.8, "largest_edge_mm": 4.0, "patch_half_width_mm": 0.6}
FINE = {"flank_edges_per_lobe": 44, "growth": 0.35, "largest_edge_mm": 2.0, "patch_half_width_mm": 0.4}
SLOW = ("whole reducer, CalculiX", "disk with holes, CalculiX")


def small_reducer(**reduce):
    """Sample 1 of the quick study with 20 pins in place of 80."""
    study = load_study("quick", ROOT)
    cycloid = {"pins": 20, "pin_radius_mm": 2.0, "eccentricity_mm": 1.2}
    design = study.design.model_copy(update={"cycloid": study.design.cycloid.model_copy(update=cycloid)})
    return Specimen(study.model_copy(update={"design": design, "reduce": study.reduce.model_copy(update=reduce)}))


@pytest.fixture(scope="module")
def crude():
    return small_reducer(**CRUDE)


@pytest.fixture(scope="module")
def rows(crude):
    """Every check, with two of three patch widths of the cylinder, and the largest of five loads of the whole reducer.

    Bodies are in plane strain, which ``test_bodies.py`` compares with plane stress.
    """
    checks = {name: check for name, check in CHECKS.items() if name not in SLOW}
    compliance = {"disk compliance": checks.pop("disk compliance")}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(laws, "WIDTHS", laws.WIDTHS[1:])
        patch.setattr(whole, "SHARES", whole.SHARES[-1:])
        patch.setattr(elasticity, "STRESSES", ("plane_strain",))
        return list(run_checks(crude, checks)) + list(run_checks(small_reducer(**FINE), compliance))


@pytest.mark.parametrize("name", [name for name in CHECKS if name not in SLOW])
@pytest.mark.long
def test_every_error_keeps_its_limit(rows, name):
    check_findings = [row.finding for row in rows if row.check == name]
    assert len(check_findings) > 3
    assert [finding for finding in check_findings if not finding.ok] == []


@pytest.mark.long
def test_committed_page_is_the_suites_and_shows_no_failure(rows):
    text = (ROOT / PAGE).read_text()
    page_text = page(rows, "paper")
    assert text.split("\n\n")[:2] == page_text.split("\n\n")[:2]
    assert "**no**" not in text
    for name in CHECKS:
        assert f"## {name[0].upper()}{name[1:]}\n" in text
    for row in rows:
        limit = "" if row.finding.limit is None else f"{row.finding.limit:.1e}"
        assert f"| {row.finding.quantity} |" in text
        assert any(
            line.startswith(f"| {row.finding.quantity} |") and f"| {limit} |" in line for line in text.splitlines()
        )


def test_deck_of_a_sample_meets_the_condensed_model(crude, tmp_path):
    if calculix_program() is None:
        pytest.skip("no CalculiX; apt install calculix-ccx")
    specimen = Specimen(crude.study, crude.sample, 50.0).in_stress("plane_strain")
    torque = np.array([0.5 * specimen.rated_torque])
    model_value = loaded_equilibria(specimen, torque)
    answer = run_calculix(calculix_deck(specimen, torque, model_value), tmp_path)
    assert answer.angle[0] == pytest.approx(model_value.motion[0, 0, specimen.reducer.output_motion], rel=3e-4)
    np.testing.assert_allclose(answer.force[0], model_value.force[0, 0], atol=5e-4 * model_value.force.max())
    assert np.count_nonzero(answer.force[0] > 1e-6) == np.count_nonzero(model_value.force)


def test_deck_is_written_for_any_crank_and_refuses_a_loose_bearing(crude):
    turned_unit = Specimen(crude.study, crude.sample, 50.0)
    torque = np.array([1000.0, 2000.0])
    states = loaded_equilibria(turned_unit, torque)
    text = calculix_deck(turned_unit, torque, states).text.splitlines()
    contacts = len(turned_unit.reducer.contacts)
    assert text.count("*EQUATION") == contacts + 2
    assert sum(line.startswith("*SPRING") for line in text) == contacts + 2
    assert text.count("*STEP, NLGEOM, INC=10000") == 2
    assert max(map(len, text)) <= 132
    tables = [part.split("*")[0].splitlines() for part in "\n".join(text).split("NONLINEAR\n")[1:]]
    assert max(map(len, tables)) <= 200  # beyond it CalculiX overwrites its memory
    design = crude.study.design
    loose = design.model_copy(update={"bearing": design.bearing.model_copy(update={"clearance_um": 1.0})})
    refusal = Specimen(crude.study.model_copy(update={"design": loose}))
    with pytest.raises(InputError, match="clearance 0.001 mm"):
        calculix_deck(refusal, torque, states)


def test_a_failed_row_is_the_commands_failure(monkeypatch, tmp_path, capsys):
    def wrong(specimen):
        """A check that fails, states, and skips."""
        yield largest_difference("one of two", [1.0, 2.0], [1.0, 2.5], 0.1)
        yield reported_number("a number", 3.0)
        yield skipped_check("needs a program; how to install it")

    monkeypatch.setattr(suite, "CHECKS", {"wrong": wrong})
    monkeypatch.setattr(settings, "RUNS", tmp_path)
    with pytest.raises(SystemExit) as exit_status:
        cli.main(["verify", "--mesh", "coarse"])
    assert exit_status.value.code == 1
    with (tmp_path / "verify" / "results.csv").open() as file:
        table = list(csv.DictReader(file))
    assert tuple(table[0]) == COLUMNS
    assert [line["ok"] for line in table] == ["False", "True", ""]
    assert (table[0]["reference"], table[0]["computed"], float(table[0]["error"])) == ("2", "2.5", 0.5)
    assert "needs a program; how to install it" in capsys.readouterr().out


def test_a_run_with_a_skipped_check_leaves_the_committed_page(monkeypatch, tmp_path, capsys, crude):
    def without_program(specimen):
        """A check that needs a program."""
        yield skipped_check("needs a program; how to install it")

    monkeypatch.setattr(suite, "CHECKS", {"program": without_program})
    monkeypatch.setattr(suite, "Specimen", lambda study: crude)
    monkeypatch.setattr(suite, "load_study", lambda *names: None)
    assert suite.verify("paper", tmp_path, tmp_path / "results.csv") == 0
    assert not (tmp_path / suite.PAGE).exists()
    assert "is left as it is: skipped were program" in capsys.readouterr().out


def test_the_laws_and_bearings_of_a_study_decide_which_checks_apply(crude):
    assert [name for name in CHECKS if suite.why_not(name, crude.study) and name not in suite.OF_OWN_DESIGNS] == []
    assert "the law linear" in suite.why_not("contact laws", load_study("li_guan", ROOT))
    design = crude.study.design.with_section("bearing", clearance_um=1.0)
    loose = crude.study.model_copy(update={"design": design})
    assert "without clearance" in suite.why_not("equilibrium", loose)
    assert suite.why_not("linear springs", loose) == ""
    one_disk_rv = load_study("rv", ROOT)
    assert "two opposed disks; this design has 1" in suite.why_not("RV reducer", one_disk_rv)
    assert "this one has holes" in suite.why_not("turn", one_disk_rv)


def test_of_an_rv_reducer_every_check_holds_or_says_why_it_does_not_apply(monkeypatch, tmp_path, capsys):
    """Ratio, crank bearings and first stage in closed form; what knows one disk or a plate alone gives its reason."""
    checks = {name: check for name, check in suite.CHECKS.items() if name not in ("profile", "contact laws")}
    monkeypatch.setattr(suite, "CHECKS", checks)
    monkeypatch.setattr(settings, "RUNS", tmp_path)
    assert cli.main(["verify", "--study", "rv_80e"]) == 0
    with (tmp_path / "verify" / "rv_80e.csv").open() as file:
        table = list(csv.DictReader(file))
    assert {row["check"] for row in table} == set(checks)
    judged = {row["check"] for row in table if row["limit"]}
    assert judged == {"modified flank", "RV reducer"}
    assert all("does not apply: " in row["quantity"] for row in table if not row["ok"])
    ratio = next(row for row in table if row["quantity"].startswith("total ratio"))
    assert float(ratio["reference"]) == 1 + 38 / 10 * 40  # Yang and others: 153
    reason = "it solves one disk and a sliding plate; this design has others (disks: 2, output: carrier)"
    assert reason in capsys.readouterr().out


def test_export_names_a_sample_that_the_study_lacks(capsys):
    assert cli.main(["export-ccx", "quick", "--sample", "99999"]) == 2
    assert "samples 0 to" in capsys.readouterr().err


def test_what_a_finding_accepts(tmp_path):
    assert not largest_difference("q", [0.0, 1.0], [np.nan, 1.0], 1.0).ok
    assert largest_difference("q", 2.0, [2.0, 2.1], 0.06, scale=2.0).ok
    assert not positive("q", [1.0, 0.0]).ok
    assert at_least("q", 0.0, [0.0, 1.0]).ok
    row = CheckRow("c", Finding("q", 1.0, 1.0, 0.0, 0.0), 0.25)
    write_results([row, replace(row, finding=reported_number("s", 1.0))], tmp_path / "r.csv")
    assert (tmp_path / "r.csv").read_text().splitlines()[1:] == ["c,q,1,1,0,0,True,0.250", "c,s,,1,,,True,0.250"]
