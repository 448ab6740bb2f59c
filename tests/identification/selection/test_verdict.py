"""The five words of the verdict on constructed selections."""

from dataclasses import replace

import numpy as np
import pytest
from linear_problem import BLOCKS, EVERYTHING, fitter_at
from measured_bench import ROOT, measured, write_unit

from pipeline.identification.fitting.problem import Model, candidates
from pipeline.identification.identify import FaultyUnit, identify
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.identification.selection.cross_validation import Trial
from pipeline.identification.selection.held_out import AngleError
from pipeline.identification.selection.judgement import Selection
from pipeline.identification.selection.statements import verdict
from pipeline.identification.selection.statements.remainder import Remainder
from pipeline.identification.selection.statements.statement import stated
from pipeline.identification.selection.statements.verdict import MOSTLY_REMOVED, judge
from pipeline.statistics.curve_scatter import CurveScatter


def selection_of(fitter, base_rms, trials, members, best):
    """A selection whose trials have the given held-out rms by the names of their models."""

    def trial(name, rms):
        model = Model(tuple(candidates()[part] for part in name.split("+") if part))
        return Trial(fitter.fit(model), np.full(BLOCKS, rms**2))

    selected_trials = {name: trial(name, rms) for name, rms in trials.items()}
    claimed = best if best.count("+") < 2 else ""
    return Selection(
        trial("", base_rms), selected_trials, {}, {}, {}, tuple(selected_trials) if best else (), best, claimed, members
    )


SINGLES = ("coulomb", "flank_wear", "preload", "seat_compliance")
CASES = {
    "nothing gains": (1.0, {"coulomb": 0.99}, (), "", "adequate", ()),
    "one effect": (5.0, {"coulomb": 1.02}, ("coulomb",), "coulomb", "identified", ("coulomb",)),
    "two together": (
        *(5.0, {"coulomb": 3.0, "coulomb+preload": 1.0}, ("coulomb+preload",), "coulomb+preload"),
        *("identified", ("coulomb+preload",)),
    ),
    "two alike": (5.0, dict.fromkeys(SINGLES[:2], 1.0), SINGLES[:2], "coulomb", "equivalent", SINGLES[:2]),
    "four alike": (5.0, dict.fromkeys(SINGLES, 1.0), SINGLES, "coulomb", "equivalent", SINGLES),
    "nothing in the library": (5.0, {"coulomb": 4.9}, (), "", "unexplained", ()),
    "not enough": (
        5.0,
        {"coulomb": 1.05 * (1 - MOSTLY_REMOVED) * 5.0},
        ("coulomb",),
        "coulomb",
        "unexplained",
        (),
    ),
    "most of it": (
        *(50.0, {"coulomb": 0.95 * (1 - MOSTLY_REMOVED) * 50.0}, ("coulomb",), "coulomb"),
        *("mostly explained", ("coulomb",)),
    ),
    "three together": (
        *(5.0, {"coulomb+preload+flank_wear": 1.0}, ("coulomb+preload+flank_wear",), "coulomb+preload+flank_wear"),
        *("unexplained", ()),
    ),
}


def statement(result, selection):
    """What is said of a verdict whose held-out errors are the scores of its selection, in two arcmin a floor."""
    rms_before, rms_after = selection.base.rms, selection.answer.rms
    errors = [AngleError(2.0 * floors, 9.0, {}, floors, 1.0, 10) for floors in (rms_before, rms_after)]
    scatter = CurveScatter(1.0, 0.5, 3.0, 3)
    remainder = Remainder(rms_after, 1 - rms_after / rms_before, 1.0, 1.0, scatter, 0.1)
    return stated(result, selection, *errors, remainder, in_sample=False)


@pytest.mark.parametrize("name", CASES)
def test_words_of_the_verdict(name):
    base_losses, trials, members, best, word, names = CASES[name]
    fitter = fitter_at([1.0, 0.5, -0.5], effects=3)
    selection = selection_of(fitter, base_losses, trials, members, best)
    judged_selection = judge(fitter, selection, EVERYTHING)
    message = statement(judged_selection, selection)
    assert judged_selection.verdict == word
    assert judged_selection.named == names
    titles = {candidates()[part].title for item in names for part in item.split("+")}
    if len(names) <= 3:
        assert all(title in message.sentence for title in titles)
    assert [p.effect for p in judged_selection.parameters] == [part for item in names for part in item.split("+")]
    assert bool(message.advice) == (word in ("equivalent", "mostly explained", "unexplained"))
    if word == "unexplained":
        assert "nothing is claimed" in message.sentence
    assert f"{2 * base_losses:.3g} arcmin ({base_losses:.3g} noise floors)" in message.sentence
    assert message.sentence.count("noise floors)") == (2 if best or word == "unexplained" else 1)


STRONG = np.log(11.4)


def freed_selection(fitter, claimed, best_rms, freed_rms, monkeypatch):
    """A base whose calibrated number stands at the end of its range, and reaches an rms once it may leave it."""
    trials = {claimed: best_rms} if claimed else {}
    selection = selection_of(fitter, 5.0, trials, (claimed,) if claimed else (), claimed)
    reach = np.array([[-2.0], [2.0]])
    base = selection.base
    bounded_fit = replace(base.fit, unknowns=replace(base.fit.unknowns, scales=np.array([2.0]), reach=reach))
    freed_fit = replace(bounded_fit, unknowns=replace(bounded_fit.unknowns, scales=np.array([STRONG]), reach=2 * reach))
    monkeypatch.setattr(verdict, "released", lambda *_: Trial(freed_fit, np.full(BLOCKS, freed_rms**2)))
    return replace(selection, base=Trial(bounded_fit, base.losses), stretched=base)


def test_a_unit_that_only_an_implausible_refit_explains_is_not_adequate(monkeypatch):
    fitter = fitter_at([1.0])
    selection = freed_selection(fitter, "", 0.0, 1.0, monkeypatch)
    judged_selection = verdict.judge(fitter, selection, EVERYTHING)
    assert (judged_selection.verdict, judged_selection.named) == ("unexplained", ())
    expected_reason = "would be explained only by bearing.stiffness x 11.4 (plausible 0.135 to 7.39)"
    assert expected_reason in statement(judged_selection, selection).sentence
    assert expected_reason in judged_selection.findings[0]
    assert judged_selection.calibrated[0].leaves


def test_an_implausible_refit_beside_a_named_effect_is_said(monkeypatch):
    fitter = fitter_at([1.0])
    selection = verdict.judge(fitter, freed_selection(fitter, "coulomb", 1.1, 1.0, monkeypatch), EVERYTHING)
    assert (selection.verdict, selection.named) == ("identified", ("coulomb",))
    assert "Without any effect bearing.stiffness x 11.4" in selection.findings[0]
    worse = verdict.judge(fitter, freed_selection(fitter, "coulomb", 1.1, 2.0, monkeypatch), EVERYTHING)
    assert not worse.findings


def test_an_effect_beside_an_implausible_number_explains_mostly(monkeypatch):
    fitter = fitter_at([1.0])
    selection = verdict.judge(fitter, freed_selection(fitter, "coulomb", 3.0, 1.0, monkeypatch), EVERYTHING)
    assert (selection.verdict, selection.named) == ("mostly explained", ("coulomb",))
    assert "What is left would be explained only by" in selection.findings[-1]
    worse = verdict.judge(fitter, freed_selection(fitter, "coulomb", 3.0, 2.0, monkeypatch), EVERYTHING)
    assert worse.verdict == "unexplained"


def test_a_model_that_is_not_claimed_says_why():
    fitter = fitter_at([1.0])
    selection = selection_of(fitter, 5.0, {"coulomb": 1.0}, (), "")
    selection = replace(selection, unsupported={"coulomb": "coulomb: torque_Nm = 6 is at a bound"})
    judged_selection = verdict.judge(fitter, selection, EVERYTHING)
    assert judged_selection.verdict == "unexplained"
    assert "coulomb, is not claimed (coulomb: torque_Nm = 6 is at a bound)" in judged_selection.findings[0]


def unlikely(trial):
    """The trial with tolerances that no unit has."""
    wide_end = replace(trial.fit.unknowns, modes=np.array([9.0, 9.0, 9.0]))
    return replace(
        trial, fit=replace(trial.fit, unknowns=wide_end, jacobian=np.pad(trial.fit.jacobian, ((0, 0), (0, 3))))
    )


@pytest.mark.parametrize("best", ["", "coulomb"])
def test_tolerances_that_no_unit_has_are_never_adequate_and_support_no_claim(best):
    fitter = fitter_at([1.0])
    selection = selection_of(fitter, 5.0 if best else 1.0, {best: 1.0} if best else {}, (best,) if best else (), best)
    trials = {name: unlikely(item) for name, item in selection.trials.items()}
    judged_selection = verdict.judge(
        fitter, replace(selection, base=unlikely(selection.base), trials=trials), EVERYTHING
    )
    assert judged_selection.named == ()
    assert judged_selection.verdict == "unexplained"
    assert "tolerances" in judged_selection.findings[0]


def test_unit_with_a_data_fault_has_no_model(tmp_path):
    rows = measured()
    rows["torque_Nm"] = 0.0
    unit = load_measured_unit(write_unit(tmp_path / "u", {"rows.csv": rows}), ROOT)
    identification = identify(unit, lambda *_: pytest.fail("nothing is to be computed of faulty data"))
    assert identification.verdict.verdict == "data fault"
    assert identification.verdict.named == ()
    assert isinstance(identification, FaultyUnit)
    assert all(fault.message in identification.statement.sentence for fault in identification.measurement.fatal)
