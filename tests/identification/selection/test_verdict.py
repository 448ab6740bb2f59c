"""The terms of the verdict on constructed selections, their sentences and what is read first."""

from types import SimpleNamespace

import numpy as np
import pytest
from measured_bench import ROOT, measured, write_unit
from test_criteria import Known, trial

from pipeline.identification.fitting.problem import candidates
from pipeline.identification.identify import FaultyUnit, identify
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.identification.selection.criteria import Selection
from pipeline.identification.selection.held_out import AngleError
from pipeline.identification.selection.statements import verdict as verdicts
from pipeline.identification.selection.statements.remainder import Remainder
from pipeline.identification.selection.statements.statement import (
    _comparison,
    place_of_largest,
    statement_of_verdict,
    title_of,
)
from pipeline.identification.selection.statements.verdict import judge, verdict_without_test
from pipeline.statistics.curve_scatter import CurveScatter

SINGLES = ("coulomb", "flank_wear", "preload", "seat_compliance")
CASES = {
    "nothing": ((), "adequate"),
    "one effect": (SINGLES[:1], "identified"),
    "two together": (("coulomb+preload",), "identified"),
    "two alike": (("coulomb", "seat_compliance"), "equivalent"),
    "four alike": (("coulomb", "seat_compliance", "torque_zero", "torque_gain"), "equivalent"),
    "one that tolerances can be": (("flank_wear", "torque_gain"), "within tolerance"),
}
TOLERATED = ("flank_wear", "preload")


@pytest.fixture(autouse=True)
def plain_numbers(monkeypatch):
    monkeypatch.setattr(verdicts, "calibrated_numbers", lambda *_: ())
    monkeypatch.setattr(verdicts, "refit_with_free_numbers", lambda *_: None)


def fitter():
    problem = SimpleNamespace(within_tolerance=lambda model, _: model.name in TOLERATED)
    return SimpleNamespace(problem=problem, bounds=lambda model: [(0.0, 10.0)] * model.n_parameters)


def selection_of(members, left=0.1, best="", modes=()):
    names = members or ((best,) if best else ())
    trials = {name: trial(name, Known(50.0), 1.0) for name in names}
    for known in trials.values():
        known.evidence.deviations = np.full(9, 0.01)
    base = trial("", Known(0.0, left=left, modes=modes), 5.0, modes=len(modes))
    odds = dict.fromkeys(names, 45.0) | {"rayleigh": 4.0}
    trials["rayleigh"] = trial("rayleigh", Known(4.0), 4.0)
    reasons = {best: "the interval reaches zero"} if best else {}
    best = best or (members[0] if members else "")
    return Selection(base, trials, odds=odds, reasons=reasons, best_model=best, members=members)


def statement(result, selection, where="", expected=1.0, to_noise=5.0):
    errors = [AngleError(2.0 * floors, 9.0, {}, floors, expected, 10) for floors in (to_noise, 1.0)]
    remainder = Remainder(1.0, 0.8, 1.0, 1.0, CurveScatter(1.0, 0.5, 3.0, 3), 0.1)
    return statement_of_verdict(result, selection, *errors, remainder, in_sample="", where=where)


@pytest.mark.parametrize("name", CASES)
def test_terms_of_the_verdict(name):
    members, term = CASES[name]
    selection = selection_of(members)
    result = judge(fitter(), selection, np.ones(4, bool))
    message = statement(result, selection)
    assert (result.verdict, result.named_effects) == (term, members)
    if len(members) <= 3:
        assert all(title_of(member) in message.sentence for member in members)
    assert [p.effect for p in result.parameters] == [part for member in members for part in member.split("+")] or (
        "flank_wear" in members
    )
    assert "10 arcmin (5 times the measurement noise)" in message.sentence
    assert message.advice
    glance = dict(message.glance)
    assert ("no cause named" in glance["Cause"]) == (not members)
    assert ("How sure" in glance) == ("How large" in glance) == bool(members)
    assert "rayleigh" in glance["Next candidate"] or "hysteresis" in glance["Next candidate"]


def test_the_advice_for_a_class_of_pairs_is_on_what_they_do_not_share():
    members = ("coulomb+torque_zero", "coulomb+seat_compliance")
    selection = selection_of(members)
    advice = statement(judge(fitter(), selection, np.ones(4, bool)), selection).advice
    for name, is_told in (("coulomb", False), ("torque_zero", True), ("seat_compliance", True)):
        assert (candidates()[name].told_apart_by in advice) == is_told


@pytest.mark.parametrize(
    ("behind", "said"), [(4.5, ", 90 times less probable ("), (0.5, " (")]
)
def test_how_much_less_probable_a_further_member_of_a_class_is(behind, said):
    selection = selection_of(("coulomb", "seat_compliance"))
    selection.odds["seat_compliance"] -= behind
    result = judge(fitter(), selection, np.ones(4, bool))
    assert f"{title_of('seat_compliance')}{said}" in statement(result, selection).sentence


@pytest.mark.parametrize(("expected", "to_noise", "said"), [(3.0, 5.0, True), (3.0, 1.0, False), (1.0, 5.0, False)])
def test_what_a_right_model_would_leave_is_said_where_both_are_above_the_noise(expected, to_noise, said):
    selection = selection_of(())
    result = judge(fitter(), selection, np.ones(4, bool))
    message = statement(result, selection, expected=expected, to_noise=to_noise)
    assert ("would be expected to leave 3 times the noise" in message.sentence) == said


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"left": 3.0}, ""),
        ({"best": "coulomb"}, "The most probable, coulomb, is not named: the interval reaches zero"),
        ({"modes": (5.0, 3.0)}, "tolerances found in only"),
    ],
)
def test_structure_a_withheld_name_or_odd_tolerances_are_never_adequate(options, reason):
    selection = selection_of((), **options)
    result = judge(fitter(), selection, np.ones(4, bool))
    assert result.verdict == "not explained by the library"
    assert reason in " ".join(result.findings)
    message = statement(result, selection)
    assert "No cause named" in message.sentence
    glance = dict(message.glance)
    assert glance["Cause"] == "no cause named"
    if "best" in options:
        assert "The nearest, constant friction of seals and bearings, leaves" in message.sentence
        assert glance["Nearest effect"].endswith(
            "removes 80% of the error in measures of the noise. It is not named, because the interval reaches zero"
        )
    else:
        assert "Nearest effect" not in glance


@pytest.mark.parametrize(
    ("testable", "term"), [(True, "not explained by the library"), (False, "not testable with these data")]
)
def test_adequate_needs_a_passed_test(testable, term):
    adequate = judge(fitter(), selection_of(()), np.ones(4, bool))
    result = verdict_without_test(adequate, "a reason", testable)
    assert result.verdict == term
    assert result.findings[-1] == "a reason"


@pytest.mark.parametrize(
    ("odds", "claimed", "said"),
    [
        (4.72, "", "110 times more probable than no effect; a name takes 999 times"),
        (-7.4, "", "1,600 times less probable than no effect"),
        (7.0, "coulomb", "20 times less probable than the cause named"),
    ],
)
def test_how_near_a_model_came_is_said_with_what_a_name_takes(odds, claimed, said):
    selection = SimpleNamespace(odds={"coulomb": 10.0, "preload": odds}, claimed_model=claimed)
    assert _comparison(selection, "preload") == said


@pytest.mark.parametrize(("scale", "place"), [(1.0, "9.1"), (1000.0, "9100")])
def test_the_place_of_a_misfit_is_told_by_torque_and_branch(scale, place):
    torque = scale * np.tile(np.linspace(-12, 12, 121), 2)
    senses = np.repeat([1.0, -1.0], 121)
    data = SimpleNamespace(torque=torque, senses=senses, sigma=np.ones(242))
    change = np.exp(-((torque / scale - 9.0) ** 2)) * (senses < 0)
    words = place_of_largest(data, change, np.ones(242, bool))
    assert words == f"largest near {place} N m on the branch of falling torque"


def test_unit_with_a_data_fault_has_no_model(tmp_path):
    rows = measured()
    rows["torque_Nm"] = 0.0
    unit = load_measured_unit(write_unit(tmp_path / "u", {"rows.csv": rows}), ROOT)
    identification = identify(unit, lambda *_: pytest.fail("nothing is to be computed of faulty data"))
    assert identification.verdict.verdict == "data fault"
    assert identification.verdict.named_effects == ()
    assert isinstance(identification, FaultyUnit)
    first_of_kinds = {fault.kind: fault.message for fault in reversed(identification.measurement.fatal)}
    assert all(message in identification.statement.sentence for message in first_of_kinds.values())
