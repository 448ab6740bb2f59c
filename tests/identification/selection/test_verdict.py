"""The five words of the verdict on constructed selections, and the cover of the intervals of a linear problem."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from measured_bench import ROOT, measured, write_unit
from scipy.stats import binom, norm

from pipeline.identification.fitting.parameters import Fit, Vector
from pipeline.identification.fitting.problem import Data, Model, candidates
from pipeline.identification.identify import FaultyUnit, identify
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.identification.selection import parameter_intervals
from pipeline.identification.selection.cross_validation import Trial
from pipeline.identification.selection.held_out import AngleError
from pipeline.identification.selection.judgement import Selection
from pipeline.identification.selection.parameter_intervals import FORM, STRUCTURE, _positive, intervals, unsupported
from pipeline.identification.selection.statements import verdict
from pipeline.identification.selection.statements.remainder import Remainder
from pipeline.identification.selection.statements.statement import stated
from pipeline.identification.selection.statements.verdict import MOSTLY_REMOVED, judge
from pipeline.model.effects.effect import CYCLES, TIME
from pipeline.statistics.curve_scatter import CurveScatter

BLOCKS, CELLS = 24, 20
BOUNDS = (-4.0, 6.0)


class LinearFitter:
    """Angle = slope x value: one number of an effect, and one calibrated number that the prior holds.

    With ``confused`` the calibrated number, ``scale`` in truth, shows mostly as so much of the first effect.
    """

    def __init__(self, truth, noise, rng, effects=1, confused=None, scale=0.0):
        n = BLOCKS * CELLS
        self.design = rng.normal(size=(n, effects + 1))
        if confused is not None:
            self.design[:, 0] = confused * self.design[:, 1] + 1e-3 * self.design[:, 0]
        block = np.repeat(np.arange(BLOCKS), CELLS)
        shared = 0.5 * noise * rng.normal(size=BLOCKS)[block]  # what the cells of a block have in common
        angle = self.design @ np.append(scale, truth) + shared + noise * rng.normal(size=n)
        torque = np.tile(np.linspace(-1, 1, CELLS), BLOCKS)
        count, whole = np.ones(n, np.int64), block // BLOCKS
        self.problem = SimpleNamespace(
            calibrated=("bearing.stiffness",),
            bounds=lambda effect: (BOUNDS,) * len(effect.parameters),
            record={TIME: 3.0, CYCLES: 2.0},
            scale_range=np.array([[-2.0], [2.0]]),
            scale_spread=np.array([1.0]),
            data=Data(
                position=block % 2,
                cycle=whole,
                block=block,
                branch=block,
                torque=torque,
                angle=angle,
                count=count,
                spread=np.full(n, noise),
                noise=noise,
                sigma=np.full(n, noise),
                common_offset=False,
            ),
        )

    def bounds(self, model):
        return [BOUNDS] * model.n_parameters

    def penalty(self, sample_like):
        return np.concatenate(
            [np.ones(len(sample_like.scales)), np.zeros(len(sample_like.shares)), np.ones(len(sample_like.modes))]
        )

    def centre(self, model, sample_like):
        return np.zeros(len(sample_like.flat))

    def fit(self, model):
        """Least squares with the prior, as a ``Fit``."""
        data, width = self.problem.data, BOUNDS[1] - BOUNDS[0]
        k = model.n_parameters
        jacobian = self.design[:, : k + 1] * np.array([1.0, *[width] * k])
        rows = np.vstack([jacobian / data.sigma[:, None], np.eye(1, k + 1)])
        start = np.full(k, -BOUNDS[0] / width)
        right = np.append(data.angle / data.sigma, 0.0)
        result = np.linalg.lstsq(rows, right, rcond=None)[0]
        shares = np.clip(start + result[1:], 0.0, 1.0)
        predicted = jacobian @ np.append(result[:1], shares - start)
        values = BOUNDS[0] + width * shares
        vector = Vector(result[:1], shares, np.zeros(0))
        return Fit(model, vector, values, predicted, 0.0, jacobian, data.sigma, True)


EVERYTHING = np.ones(BLOCKS * CELLS, bool)
COULOMB = Model((candidates()["coulomb"],))


def fitter_at(truth, noise=0.1, seed=0, effects=1):
    return LinearFitter(truth, noise, np.random.default_rng(seed), effects)


@pytest.mark.parametrize("truth", [2.0, -1.5])
def test_intervals_cover_the_truth_as_often_as_they_say(truth, monkeypatch):
    monkeypatch.setattr(parameter_intervals, "FORM", 0.0)  # the form of this model is right
    runs, covered, widths = 200, 0, []
    for seed in range(runs):
        fitter = fitter_at(truth, seed=seed)
        (result,) = intervals(fitter, fitter.fit(COULOMB), EVERYTHING, 0.0)
        covered += result.ci_low <= truth <= result.ci_high
        widths.append(result.ci_high - result.ci_low)
        assert result.ci_low < result.value < result.ci_high
    low, high = binom.ppf([1e-3, 1 - 1e-3], runs, 0.95)
    assert low - 4 <= covered <= high  # 24 blocks: a little narrow
    usual = 2 * 1.96 * 0.1 * np.sqrt(1.25 / (BLOCKS * CELLS))
    assert 0.8 * usual < np.median(widths) < 1.3 * usual


def test_intervals_hold_what_a_calibrated_number_may_be(monkeypatch):
    """Its truth is drawn from its prior, which alone tells it from the parameter."""
    monkeypatch.setattr(parameter_intervals, "FORM", 0.0)
    runs, covered, widths, truth = 200, 0, [], 1.0
    for seed in range(runs):
        rng = np.random.default_rng(1000 + seed)
        fitter = LinearFitter(truth, 0.1, rng, confused=0.5, scale=rng.standard_normal())
        (result,) = intervals(fitter, fitter.fit(COULOMB), EVERYTHING, 0.0)
        covered += result.ci_low <= truth <= result.ci_high
        widths.append(result.ci_high - result.ci_low)
    low, high = binom.ppf([1e-3, 1 - 1e-3], runs, 0.95)
    assert low <= covered <= high
    assert np.median(widths) == pytest.approx(2 * 1.96 * 0.5, rel=0.15)


def test_intervals_hold_what_the_form_of_the_model_may_miss():
    fitter = fitter_at(2.0)
    fit = fitter.fit(COULOMB)
    (reference,), (wide,) = intervals(fitter, fit, EVERYTHING, 0.0), intervals(fitter, fit, EVERYTHING, 8.0)
    rows = np.vstack([fit.jacobian / fit.sigma[:, None], np.eye(1, 2)])
    variance = np.linalg.inv(rows.T @ rows)[1, 1]
    form = norm.ppf(0.975) * FORM * 8.0 * np.sqrt(CELLS * variance) * (BOUNDS[1] - BOUNDS[0])
    assert np.sqrt(STRUCTURE**2 - 1) > FORM * 8.0  # beyond, most of it would be left in the residual
    for narrow_end, wide_end in ((reference.ci_low, wide.ci_low), (reference.ci_high, wide.ci_high)):
        assert abs(wide_end - reference.value) == pytest.approx(np.hypot(narrow_end - reference.value, form), rel=1e-6)
    (wide_end,), (type_name,) = intervals(fitter, fit, EVERYTHING, 50.0), intervals(fitter, fit, EVERYTHING, 500.0)
    assert (wide_end.ci_low, wide_end.ci_high) == (type_name.ci_low, type_name.ci_high)


def test_intervals_hold_a_share_of_what_an_effect_is_itself():
    """The form of the model may scale an effect: however many cells there are, its number is no better known."""
    fitter = fitter_at(4.0, noise=1e-4)
    (result,) = intervals(fitter, fitter.fit(COULOMB), EVERYTHING, 0.0)
    assert result.ci_high - result.value == pytest.approx(norm.ppf(0.975) * FORM * 4.0, rel=0.02)


def test_parameter_at_its_bound_has_no_interval_and_says_so():
    fitter = fitter_at(9.0)
    (result,) = intervals(fitter, fitter.fit(COULOMB), EVERYTHING, 0.0)
    assert result.value == BOUNDS[1]
    assert np.isnan(result.ci_low)
    assert "bound" in result.note


@pytest.mark.parametrize(
    ("effect", "truth", "reason"),
    [
        ("coulomb", [2.0], ""),
        ("coulomb", [-1.0], ""),
        ("coulomb", [0.003], "the interval of torque_Nm reaches zero"),
        ("coulomb", [9.0], "torque_Nm = 6 is at a bound"),
        ("ovality_2", [2.0, 0.0], ""),  # one amplitude may be zero
        ("ovality_2", [0.004, -0.003], "joint interval of its amplitudes reaches zero"),
        ("creep", [1.0, 2.0], ""),
        ("creep", [1.0, 4.0], "time_s = 4 is longer than the record"),
        ("run_in", [1.0, 2.5], "cycles = 2.5 is longer than the record"),
    ],
)
def test_parameters_that_support_no_claim(effect, truth, reason):
    fitter = fitter_at(truth, effects=len(truth))
    fit = fitter.fit(Model((candidates()[effect],)))
    result = unsupported(fitter, fit, EVERYTHING, 0.0)
    assert (reason in result) if reason else not result


def test_an_effect_that_was_tested_against_its_absence_may_have_a_size_that_is_open():
    """Of a size and a time constant that trade in a valley the size is open upwards, and never zero."""
    fitter = fitter_at([0.003])
    fit = fitter.fit(COULOMB)
    assert "reaches zero" in unsupported(fitter, fit, EVERYTHING, 0.0)
    assert not unsupported(fitter, fit, EVERYTHING, 0.0, present=True)
    shares, ends = np.array([0.2, 0.2, 0.5]), (np.array([0.1, -0.2, -0.1]), np.array([0.3, 0.6, 1.1]))
    low, high = _positive([(0.0, 5.0), (0.0, 5.0), (-5.0, 5.0)], shares, ends)
    np.testing.assert_allclose(low, [0.1, 0.2 * np.exp(-2), -0.1])
    np.testing.assert_allclose(high, [0.3, 0.2 * np.exp(2), 1.1])


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
    wide_end = replace(trial.fit.unknowns, modes=np.array([3.0, 3.0, 3.0]))
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
