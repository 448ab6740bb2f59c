"""What is chosen of constructed trials: effects for their gains, the simpler of two, classes, and what may be left."""

from dataclasses import replace
from types import MappingProxyType, SimpleNamespace

import numpy as np
import pytest

from pipeline.identification.fitting.parameters import Fit, Vector
from pipeline.identification.fitting.problem import Model, candidates, twins
from pipeline.identification.selection import judgement, model_selection
from pipeline.identification.selection.cross_validation import Trial
from pipeline.identification.selection.judgement import ALIKE, FAMILYWISE, LEAST_GAIN, LEAST_SHARE, SET_LEVEL, Selection
from pipeline.identification.selection.model_selection import Selector
from pipeline.identification.selection.parameter_intervals import FORM, STRUCTURE
from pipeline.identification.selection.screening import Promise
from pipeline.statistics.blocks import confidence_set

BRANCHES, CYCLES, CELLS = 8, 3, 5
SIGMA = 0.2
BLOCK = np.repeat(np.arange(BRANCHES * CYCLES), CELLS)
EVERYTHING = np.ones(len(BLOCK), bool)
RIPPLED = (-1.0) ** np.arange(BRANCHES * CYCLES)
"""Unequal blocks without a mean."""
LUCK = np.where(np.arange(BRANCHES * CYCLES) < 2, 10.0, 0.0)
"""Losses of two blocks: a model without them gains by chance."""


@pytest.fixture(autouse=True)
def parameters_known(monkeypatch):
    """How far effects are from their limit cases, unless a test leaves it open."""
    monkeypatch.setattr(judgement, "determined", lambda *_: True)


def selector(cycles=CYCLES, most_effects=4, tolerated=(), refusal=MappingProxyType({})):
    """A selector that is asked to judge only."""
    data = SimpleNamespace(block=BLOCK, branch=BLOCK // cycles, sigma=np.full(len(BLOCK), SIGMA))
    selector_made = Selector.__new__(Selector)
    selector_made.problem = SimpleNamespace(data=data, within_tolerance=lambda model, _: model.name in tolerated)
    selector_made.most_effects = most_effects
    selector_made.testable = dict(candidates())
    selector_made.fitter = None
    selector_made.why_no_claim = lambda candidate, *_: refusal.get(candidate.fit.model.name, "")
    return selector_made


def trial(name, losses, shift=0.0):
    """Trial of a model by its name, its predictions ``shift`` sigmas from zero."""
    model = Model(tuple(candidates()[part] for part in name.split("+") if part))
    shares = np.linspace(0.1, 0.9, model.n_parameters)
    predicted = np.full(len(BLOCK), shift * SIGMA)
    unknowns = Vector(np.zeros(0), shares, np.zeros(0))
    fit = Fit(model, unknowns, shares, predicted, 0.0, np.zeros((len(BLOCK), 0)), np.full(len(BLOCK), SIGMA), True)
    return Trial(fit, np.broadcast_to(losses, BRANCHES * CYCLES).astype(float))


def trials_of(losses, shifts=None):
    return {name: trial(name, values, (shifts or {}).get(name, 0.0)) for name, values in losses.items()}


def best_of(losses, **options):
    trials = trials_of(losses)
    survivors = sorted(trials, key=lambda name: trials[name].scores.mean())
    selector_made = selector(**options)
    return selector_made._best(survivors, trials, selector_made.most_effects)


@pytest.mark.parametrize(
    ("coulomb", "presliding", "best"),
    [
        (1.5, 1.5, "coulomb"),
        (1.5, 1.5 - 0.8 * ALIKE, "coulomb"),  # in every block, but the form of the model may do as much
        (1.5, 1.5 - 4 * ALIKE, "presliding"),
        (1.5 + LUCK, 1.6, "coulomb"),  # by chance
    ],
)
def test_the_simpler_of_two_nested_effects_wins_unless_the_other_gains(coulomb, presliding, best):
    assert best_of({"coulomb": coulomb, "presliding": presliding + 1e-6 * RIPPLED}) == best


def test_the_simpler_of_nested_effects_wins_beside_another_effect_too():
    losses = {"coulomb+preload": 1.0, "preload+presliding": 1.0 - 0.8 * ALIKE}
    assert best_of(losses) == "coulomb+preload"
    assert best_of({"preload+presliding": 1.0, "seat_compliance": 9.0 + RIPPLED}) == "preload+presliding"


@pytest.mark.parametrize(
    ("loss_of_one", "gain", "count"),
    [
        (2.0, 0.9 * LEAST_GAIN, 1),
        (2.0, 1.1 * LEAST_GAIN, 2),
        (10.0, 0.9 * LEAST_SHARE * 10, 1),
        (10.0, 1.1 * LEAST_SHARE * 10, 2),
    ],
)
def test_more_effects_are_taken_only_for_a_gain_of_use(loss_of_one, gain, count):
    best = best_of({"coulomb": loss_of_one, "coulomb+preload": loss_of_one - gain + 1e-6 * RIPPLED})
    assert len(best.split("+")) == count


def test_more_effects_are_named_only_for_a_gain_that_is_not_by_chance():
    chance = 2.6
    assert best_of({"coulomb": 2.5 + LUCK, "coulomb+preload": chance}) == "coulomb"
    three_effects = {"coulomb": 9.0 + LUCK, "coulomb+preload": 2.5 + LUCK, "coulomb+flank_wear+preload": chance}
    assert best_of(three_effects) == "coulomb+flank_wear+preload"  # describes, claims nothing
    assert best_of(three_effects, most_effects=2) == "coulomb+preload"


def judged(base, losses, **options):
    return selector(**options).judged(trial("", base), trials_of(losses), {}, EVERYTHING)


def test_survivors_gain_significantly_and_as_much_as_is_of_use():
    losses = {
        "coulomb": 1.0 + 1e-3 * RIPPLED,
        "preload": 4.0 + LUCK - 0.9 * LEAST_GAIN,
        "seat_compliance": 4.1,
        "pin_radius_error": 0.9 + 1e-3 * RIPPLED,
    }
    base = 4.0 + LUCK
    selection = judged(base, losses, tolerated=("pin_radius_error",))
    assert selection.survivors == ("coulomb",)
    assert selection.best == "coulomb"
    assert selection.members == ("coulomb",)
    assert max(selection.p["coulomb"], selection.p["preload"]) <= FAMILYWISE < selection.p["seat_compliance"]
    assert selection.base.rms**2 - selection.trials["seat_compliance"].rms ** 2 > LEAST_GAIN
    assert selection.chosen is selection.trials["coulomb"]
    assert judged(base, losses).best == "pin_radius_error"


@pytest.mark.parametrize(("stretched", "best"), [(1.2, ""), (2.0, "coulomb")])
def test_an_effect_must_beat_a_refit_a_little_outside_of_the_plausible_ranges(stretched, best):
    losses = trials_of({"coulomb": 1.0 + 1e-3 * RIPPLED})
    selection = selector().judged(trial("", 4.0), losses, {}, EVERYTHING, trial("", stretched))
    assert selection.best == best
    assert selection.stretched is not None


def test_a_model_whose_parameters_support_no_claim_is_none_and_says_why():
    losses = {"coulomb": 1.0 + 1e-3 * RIPPLED, "preload": 1.0 + 0.8 * ALIKE + 1e-3 * RIPPLED}
    selection_before = judged(4.0, losses)
    assert selection_before.best == "coulomb"
    selection = selector(refusal={"coulomb": "its interval reaches zero"}).supported(selection_before, EVERYTHING)
    assert selection.best == selection.claimed == "preload"
    assert selection.members == ("preload",)
    assert selection.unsupported == {"coulomb": "its interval reaches zero"}


def test_a_model_that_explains_less_is_not_named_for_want_of_numbers_of_the_best():
    losses = {"ovality_2": 1.0 + 1e-3 * RIPPLED, "preload": 1.5 + 1e-3 * RIPPLED}
    refusal = {"ovality_2": "the joint interval reaches zero"}
    selection = selector(refusal=refusal).supported(judged(4.0, losses), EVERYTHING)
    assert (selection.best, selection.claimed, selection.members) == ("", "", ())
    part = {"ovality_2+preload": 1.0 + 1e-3 * RIPPLED, "preload": 3.0 + 1e-3 * RIPPLED}
    refusal = {"ovality_2+preload": "the joint interval reaches zero"}
    assert selector(refusal=refusal).supported(judged(9.0, part), EVERYTHING).best == "preload"


def test_nothing_is_chosen_where_the_base_explains_the_data():
    losses = {"coulomb": 0.5 + 1e-3 * RIPPLED}
    assert judged(0.99 * STRUCTURE**2, losses).best == ""
    assert judged(1.01 * STRUCTURE**2, losses).best == "coulomb"


@pytest.mark.parametrize("base", [2.0, 40.0])
def test_what_may_be_left_grows_with_what_was_explained(base):
    selection = judged(base**2, {"coulomb": 1.0 + 1e-3 * RIPPLED})
    assert selection.limit == pytest.approx(np.sqrt(STRUCTURE**2 + (FORM * base) ** 2))
    unchanged = judged(base**2, {"coulomb": base**2})
    assert unchanged.limit == STRUCTURE
    assert unchanged.chosen is unchanged.base


def members_of(best, losses, shifts=None, cycles=CYCLES):
    trials = trials_of(losses, shifts)
    survivors = sorted(trials, key=lambda name: trials[name].scores.mean())
    return set(selector(cycles)._members(best, survivors, trials, EVERYTHING, 3.0))


def in_confidence_set(losses, cycles=CYCLES):
    """Which of two are in the confidence set over blocks, or branches of some cycles."""
    scores = np.column_stack([trial("", item).scores.reshape(-1, cycles).mean(axis=1) for item in losses])
    return confidence_set(scores, SET_LEVEL, 2000, 0).tolist()


def test_models_that_predict_alike_are_one_class_even_if_one_is_a_little_behind():
    losses_behind = 1.0 + 0.8 * ALIKE + 1e-3 * RIPPLED
    assert in_confidence_set([1.0, losses_behind]) == [True, False]
    assert members_of("coulomb", {"coulomb": 1.0, "preload": losses_behind}) == {"coulomb", "preload"}
    assert members_of("coulomb", {"coulomb": 1.0, "preload": losses_behind + 2 * ALIKE}) == {"coulomb"}


@pytest.mark.parametrize(("shift", "is_one_class"), [(0.9, True), (1.1, False)])
def test_models_that_predict_differently_are_told_apart(shift, is_one_class):
    losses = {"coulomb": 1.0, "preload": 1.0 + 1e-3 * RIPPLED}
    result = members_of("coulomb", losses, {"preload": shift})
    assert result == ({"coulomb", "preload"} if is_one_class else {"coulomb"})


def test_cycles_of_a_branch_are_no_further_evidence():
    """Losses that are alike in all cycles of few branches: over single blocks the class would be left."""
    worse = np.repeat([2.35, 1.54, 1.0, 0.64], 6)
    assert np.mean(worse) - 1 > 2 * ALIKE
    assert in_confidence_set([1.0, worse], 1) == [True, False]
    assert in_confidence_set([1.0, worse], 6) == [True, True]
    losses = {"coulomb": 1.0, "preload": worse}
    assert members_of("coulomb", losses, cycles=6) == {"coulomb", "preload"}
    assert members_of("coulomb", losses, cycles=1) == {"coulomb"}


def with_twins(monkeypatch, best, losses):
    """What is selected once the twins of the best are fitted; those without a loss have no equilibrium."""
    selector_made = selector(tolerated=())

    def fit(model, *_, **__):
        selection = losses.get(model.name)
        return SimpleNamespace(model=model, cost=np.inf if selection is None else selection, sound=True, unknowns=None)

    def promised(fitter, cells, bases, effects):
        return {effect.name: Promise(0.5, (None,)) for effect in effects}

    monkeypatch.setattr(model_selection, "screened", promised)
    selector_made.fitter = SimpleNamespace(fit=fit, start=lambda model: None)
    selector_made.trial = lambda fit, _: trial(fit.model.name, losses[fit.model.name] + 1e-3 * RIPPLED)
    base = replace(trial("", 30.0), fit=SimpleNamespace(model=Model(), cost=30.0))
    selection_before = selector_made.judged(base, {best: trial(best, losses[best] + 1e-3 * RIPPLED)}, {}, EVERYTHING)
    assert selection_before.members == (best,)
    return selector_made._with_twins(selection_before, EVERYTHING)


def test_twins_of_the_best_are_fitted_and_the_class_is_named(monkeypatch):
    losses = {"preload": 1.0, "pin_radius_error": 1.01, "pin_circle_error": 9.0}
    selection = with_twins(monkeypatch, "preload", losses)
    assert selection.trials.keys() == losses.keys()
    assert set(selection.members) == {"preload", "pin_radius_error"}


def test_a_twin_may_be_better_and_twins_of_a_pair_stand_in_its_place(monkeypatch):
    losses = {"coulomb+preload": 3.0, "coulomb+pin_radius_error": 1.0, "contact_friction+preload": 4.0, "preload": 9.0}
    losses |= {"coulomb": 9.0}
    selection = with_twins(monkeypatch, "coulomb+preload", losses)
    assert selection.best == "coulomb+pin_radius_error"
    assert {"contact_friction+preload", "coulomb+pin_radius_error"} < selection.trials.keys()


def test_twins_are_what_either_of_two_effects_declares():
    for name in candidates():
        assert all(name in twins(counterpart) for counterpart in twins(name))
    assert {"pin_radius_error", "pin_circle_error"} <= set(twins("preload"))


def test_an_effect_whose_simpler_form_does_as_well_is_no_alternative():
    losses = {"coulomb": 1.0, "presliding": 0.99, "preload": 1.0}
    assert members_of("coulomb", losses) == {"coulomb", "preload"}
    assert members_of("presliding", {"presliding": 0.99, "preload": 1.0}) == {"presliding", "preload"}


def test_a_pair_whose_simpler_form_does_as_well_is_no_alternative():
    losses = {"coulomb+preload": 1.0, "preload+presliding": 0.99}
    assert members_of("coulomb+preload", losses) == {"coulomb+preload"}


def test_a_model_whose_distance_from_its_limit_case_is_open_is_named_beside_it(monkeypatch):
    monkeypatch.setattr(judgement, "determined", lambda *_: False)
    losses = {"load_friction": 1.0, "directional_load_friction": 0.99, "preload": 1.0}
    assert members_of("load_friction", losses) == set(losses)
    assert members_of("load_friction", losses, {"directional_load_friction": 1.1}) == {"load_friction", "preload"}


def test_only_models_of_as_many_effects_are_one_class():
    assert members_of("coulomb", {"coulomb": 1.0, "coulomb+preload": 1.0}) == {"coulomb"}


def test_best_is_tried_without_each_effect_and_with_the_simpler_one():
    """From where it stands: the fits start at its shares; what is known to be better is not replaced."""
    selector_made, starts = selector(), {}

    def fit(model, _, start):
        starts[model.name] = start.shares
        return model.name

    selector_made.fitter = SimpleNamespace(fit=fit)
    selector_made.trial = lambda name, _: trial(name, 2.0)
    trials = trials_of({"presliding+preload": 1.0, "preload": 1.5, "presliding": 3.0})
    trials = {item.fit.model.name: item for item in trials.values()}
    result = selector_made._without(
        Selection(trial("", 9.0), trials, {}, {}, {}, (), "preload+presliding", "", ()), EVERYTHING
    )
    shares = trials["preload+presliding"].fit.unknowns.shares  # presliding's two, then preload's
    expected = {"presliding": shares[:2], "preload": shares[2:], "coulomb+preload": shares[[0, 2]]}
    assert starts.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(starts[name], values)
    assert result.keys() == {"presliding", "coulomb+preload"}


def test_models_near_the_best_are_fitted_without_an_effect_that_supports_no_claim_in_them(monkeypatch):
    """Rayleigh's hysteresis was taken first, stood for two others and has none of its own beside them."""
    selector_made, starts = selector(most_effects=2), {}
    losses = {"coulomb+rayleigh": 7.0, "coulomb+output_torsion+rayleigh": 1.0, "rayleigh": 40.0}
    reduced = {"coulomb+output_torsion": 1.05, "output_torsion": 50.0}  # coulomb is weak beside output_torsion

    def fit(model, _, start):
        starts[model.name] = start.shares
        return model.name

    def weak(fitter, fit, cells, base_rms):
        yield ("rayleigh" if fit.model.n_effects == 3 else "coulomb"), ""

    monkeypatch.setattr(model_selection, "shortcomings", weak)
    selector_made.fitter = SimpleNamespace(fit=fit)
    selector_made.trial = lambda name, _: trial(name, reduced[name] + 1e-3 * RIPPLED)
    known = trials_of({name: loss + 1e-3 * RIPPLED for name, loss in losses.items()})
    trials = {item.fit.model.name: item for item in known.values()}
    selection_before = selector_made.judged(trial("", 90.0), trials, {}, EVERYTHING)
    assert selection_before.best == "coulomb+rayleigh"  # no more than two may be named
    selection = selector_made._relieved(selection_before, EVERYTHING)
    assert selection.best == "coulomb+output_torsion"
    assert selection.trials.keys() - losses.keys() == {"coulomb+output_torsion", "output_torsion"}
    shares = trials["coulomb+output_torsion+rayleigh"].fit.unknowns.shares
    np.testing.assert_array_equal(starts["coulomb+output_torsion"], shares[:2])


@pytest.mark.parametrize(("residual", "fitted"), [(0.9, "abcdefg"), (0.09, "abcd"), (0.11, "abcdefg")])
def test_the_best_four_are_always_fitted_and_others_that_promise_a_tenth_of_what_was_reached(residual, fitted):
    """The second reaches ``residual``, far below what it promised; all promise about the base.s misfit."""
    promised = {"a": 0.92, "b": 0.93} | dict.fromkeys("cdefg", 0.95)
    candidate = []

    def fit(model, cells, start, *_, **__):
        candidate.append(model.effects[-1].name)
        cost = 10.0 * residual if candidate[-1] == "b" else 10.0
        return SimpleNamespace(model=model, cost=cost, sound=True, unknowns=start)

    effects = {name: SimpleNamespace(name=name) for name in promised}
    selector = SimpleNamespace(fitter=SimpleNamespace(fit=fit), testable=effects)
    promises = {name: Promise(misfit, (None,)) for name, misfit in promised.items()}
    base = SimpleNamespace(model=Model(), cost=10.0)
    Selector.fits(selector, base, np.ones(1, bool), promises, 3)
    assert "".join(dict.fromkeys(candidate)) == fitted


@pytest.mark.parametrize(
    ("scale", "costs", "followed", "taken"),
    [
        (0.02, (9.0, 9.0), [False, False], 10.0),  # on its way to where the first fit ended
        (0.3, (16.0, 5.0), [False, False], 10.0),  # far behind after its first steps
        (0.3, (14.0, 5.0), [True, False], 5.0),  # the second leads where the first did
        (0.3, (14.0, 11.0), [True, True], 10.0),
    ],
)
def test_further_starts_are_followed_where_they_lead_elsewhere_and_not_far_behind(scale, costs, followed, taken):
    spread, iterations = np.array([0.1]), []

    def fit(model, cells, start, steps=None, **_):
        if start.scales[0] == 0.0:
            return SimpleNamespace(unknowns=start, cost=10.0, sound=True)
        iterations.append(steps)
        place = replace(start, scales=np.array([scale]))
        return SimpleNamespace(unknowns=place, cost=costs[0 if steps else 1], sound=True)

    problem = SimpleNamespace(scale_range=np.array([[-0.2], [0.2]]), scale_spread=spread)
    start = Vector(np.zeros(1), np.zeros(0), np.zeros(0), problem.scale_range)
    selector = SimpleNamespace(
        fitter=SimpleNamespace(fit=fit, start=lambda _: start),
        problem=problem,
        trial=lambda fit, _: SimpleNamespace(fit=fit, rms=fit.cost),
    )
    assert Selector.recalibrated(selector, EVERYTHING).fit.cost == taken
    first = model_selection.FIRST_ITERATIONS
    assert iterations == [steps for further in followed for steps in ([first, None] if further else [first])]


def test_a_limit_case_that_ended_far_off_is_fitted_from_where_the_best_stands():
    """Presliding at its least distance is no claim, and the constant friction that it is had a minimum of its own."""
    trials = trials_of({"": 100.0, "presliding": 1.0, "coulomb": 5.5})
    choice = selector(refusal={"presliding": "a parameter is at a bound"})
    fits_from = []

    def fit(model, cells, start):
        fits_from.append((model.name, start.shares.tolist()))
        return trial(model.name, 1.0).fit

    choice.fitter = SimpleNamespace(fit=fit)
    choice.trial = lambda fit, cells: trial(fit.model.name, 1.0)
    base = trials.pop("")
    choice._with_twins = lambda selection, cells: selection
    selection = choice.extended(choice.judged(base, trials, {}, EVERYTHING), EVERYTHING)
    assert fits_from == [("coulomb", [pytest.approx(0.1)])]
    assert selection.claimed == "coulomb"
    assert selection.trials["coulomb"].rms == 1.0
