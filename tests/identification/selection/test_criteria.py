"""The rule on constructed trials, clause by clause, and on drawn linear units without an effect."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from linear_unit import LinearFitter, linear_data, model_of, stood

from pipeline.identification.fitting.parameters import Fit, Vector
from pipeline.identification.fitting.problem import Model, candidates
from pipeline.identification.selection import model_selection
from pipeline.identification.selection.covariance import SIZES, Covariance, Structure, parts_of
from pipeline.identification.selection.criteria import (
    AT_BOUND,
    FEWEST_BLOCKS,
    FORM,
    NAMED_ODDS,
    ODDS,
    Judge,
    Trial,
    form_limit,
    least_fall,
    limits_beside_name,
    most_probable,
    prior_log_odds,
    without_names,
)
from pipeline.identification.selection.evidence import Evidence
from pipeline.identification.selection.model_selection import Selector, Tries, _close_effects

TRIED = 20
SINGLE, PAIR = -prior_log_odds(1, TRIED), -prior_log_odds(2, TRIED)
"""Evidence that the prior takes from one effect, and from two."""


class Known:
    """Evidence whose numbers are given."""

    tolerance_share, covariance = Evidence.tolerance_share, None

    def __init__(self, value, gain=1.0, limited=None, distance=3.0, left=0.1, modes=(), promise=0.0):
        self.value = self.promised_value = value
        self.predictive, self.promise = np.full(3, gain), promise
        self.fit = SimpleNamespace(unknowns=SimpleNamespace(modes=np.zeros(len(modes))))
        self.training = dict.fromkeys(range(3), value)
        self.structure = Structure(left, 0.0, 0.15, 0.0)
        self.unknowns = np.array(modes, float), np.eye(len(modes))
        self._limited, self._distance = value if limited is None else limited, distance

    def without_promise(self):
        return Known(self.value - self.promise)

    def log_evidence_up_to(self, largest, largest_between_cycles):
        return self.value if np.isinf(largest) else self._limited

    def distance(self, effect, without):
        return self._distance[effect] if isinstance(self._distance, dict) else self._distance


def trial(name, evidence, rms=1.0, shares=None, modes=0):
    model = Model(tuple(candidates()[part] for part in name.split("+") if part))
    shares = np.full(model.n_parameters, 0.4) if shares is None else np.array(shares)
    unknowns = Vector(np.zeros(0), shares, np.zeros(modes))
    fit = Fit(model, unknowns, 10 * shares - 2, np.zeros(4), 0.0, np.zeros((4, 0)), np.ones(4), np.ones(4), True)
    return Trial(fit, evidence, rms)


def judged(trials, base_rms=1.05, blocks=24, bounds=(-2.0, 8.0), record=9.0):
    problem = SimpleNamespace(data=SimpleNamespace(block=np.arange(blocks)), record={"time": record, "cycles": record})
    fitter = SimpleNamespace(problem=problem, bounds=lambda model: [bounds] * model.n_parameters)
    base = trial("", Known(0.0, gain=0.0), base_rms)
    return Judge(fitter, np.ones(blocks, bool), TRIED).select(base, trials, {})


def named(**options):
    """What is named of one effect that is beyond doubt but for some numbers of its evidence."""
    return judged({"coulomb": trial("coulomb", Known(**{"value": 40.0, **options}))}).members


@pytest.mark.parametrize("base_rms", [0.99, 1.05, 5.0])
def test_no_misfit_is_too_small_or_too_large_for_an_effect(base_rms):
    trials = {"coulomb": trial("coulomb", Known(40.0), rms=0.9)}
    assert judged(trials, base_rms).members == ("coulomb",)


@pytest.mark.parametrize("effect", ["coulomb", "torque_gain", "ovality_2", "pin_circle_error"])
def test_every_effect_has_to_beat_no_effect_by_the_same_odds(effect):
    for excess, expected in ((-0.01, ()), (0.01, (effect,))):
        assert judged({effect: trial(effect, Known(SINGLE + NAMED_ODDS + excess))}).members == expected


def test_all_that_was_tried_counts_together():
    """Two effects of half the odds reject "no effect" as one does."""
    half = Known(SINGLE + NAMED_ODDS - np.log(2) + 0.01)
    assert judged({"coulomb": trial("coulomb", half)}).best_model == ""
    both = {name: trial(name, half) for name in ("coulomb", "presliding")}
    assert judged(both).best_model
    assert judged(both).members == ()  # neither of them by itself is more probable than a discrepancy


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"gain": -0.1}, "not predicted better"),
        ({"gain": [30.0, 20.0, -NAMED_ODDS - 0.1]}, "predicted worse with it by odds of 999 to 1"),
        ({"distance": 0.9}, "reaches zero"),
        ({"limited": SINGLE + NAMED_ODDS - 0.1}, "a discrepancy of no known form"),
        ({"limited": 40.0 - ODDS - 0.1}, "larger than the form of the model leaves"),
    ],
)
def test_each_clause_withholds_a_name_and_says_why(options, reason):
    trials = {"torque_gain": trial("torque_gain", Known(**{"value": 40.0, **options}))}
    selection = judged(trials)
    assert selection.best_model == "torque_gain"
    assert selection.members == ()
    assert reason in selection.reasons["torque_gain"]


def test_a_part_may_be_predicted_worse_by_less_than_the_odds_of_a_name():
    trials = {"torque_gain": trial("torque_gain", Known(value=40.0, gain=[30.0, 20.0, -NAMED_ODDS + 0.1]))}
    assert judged(trials).members == ("torque_gain",)


def test_a_shape_near_its_bound_vetoes_nothing_and_a_size_there_does():
    """Of a run-in the size is first, the number of cycles second: from 1, a bound that has no zero within."""
    evidence = Known(40.0)
    for shares, is_named in (([0.4, AT_BOUND / 2], True), ([1 - AT_BOUND / 2, 0.4], False)):
        run_in = trial("run_in", evidence, shares=shares)
        problem = SimpleNamespace(data=SimpleNamespace(block=np.arange(24)), record={"time": 99.0, "cycles": 99.0})
        fitter = SimpleNamespace(problem=problem, bounds=lambda model: [(0.0, 30.0), (1.0, 10.0)])
        base = trial("", Known(0.0, gain=0.0))
        selection = Judge(fitter, np.ones(24, bool), TRIED).select(base, {"run_in": run_in}, {})
        assert bool(selection.members) == is_named


@pytest.mark.parametrize(("waves", "is_named"), [(AT_BOUND / 2, False), (0.1, True)])
def test_the_slowest_ripple_that_is_looked_for_is_the_form_of_the_curve(waves, is_named):
    """Two units of a plastic drive without cogging had one of four waves, with phases of its own at each position."""
    ripple = trial("motor_cogging", Known(40.0), shares=[0.4, 0.6, waves])
    problem = SimpleNamespace(data=SimpleNamespace(block=np.arange(24)), record={})
    fitter = SimpleNamespace(problem=problem, bounds=lambda model: [(-5.0, 5.0), (-5.0, 5.0), (4.0, 60.0)])
    base = trial("", Known(0.0, gain=0.0))
    selection = Judge(fitter, np.ones(24, bool), TRIED).select(base, {"motor_cogging": ripple}, {})
    assert bool(selection.members) == is_named
    assert is_named or "the slowest" in selection.reasons["motor_cogging"]


def test_a_time_constant_beyond_the_record_and_tolerances_of_no_unit_are_implausible():
    far = {"run_in": trial("run_in", Known(40.0), shares=[0.5, 0.5])}
    assert judged(far).members == ("run_in",)
    assert "longer than the record" in judged(far, record=2.0).reasons["run_in"]
    odd = {"coulomb": trial("coulomb", Known(40.0, modes=(5.0, 3.0)), modes=2)}
    assert "of the study's units" in judged(odd).reasons["coulomb"]


def test_a_fit_that_is_not_sound_names_nothing():
    sound = trial("coulomb", Known(40.0))
    assert judged({"coulomb": sound}).members == ("coulomb",)
    selection = judged({"coulomb": replace(sound, fit=replace(sound.fit, sound=False))})
    assert not selection.members
    assert "equilibria that are not found" in selection.reasons["coulomb"]


def test_too_few_branches_name_nothing():
    trials = {"coulomb": trial("coulomb", Known(40.0))}
    assert judged(trials, blocks=FEWEST_BLOCKS).members
    assert not judged(trials, blocks=FEWEST_BLOCKS - 1).members


def test_a_pair_is_named_where_it_beats_the_best_single_effect_by_the_odds():
    single = trial("coulomb", Known(40.0))
    for excess, expected in ((-0.01, ("coulomb",)), (0.01, ("coulomb+preload",))):
        pair = trial("coulomb+preload", Known(40.0 + PAIR - SINGLE + NAMED_ODDS + excess), rms=0.9)
        assert judged({"coulomb": single, "coulomb+preload": pair}).members == expected


def test_a_class_has_the_odds_by_its_best_member_and_the_others_by_their_distance_from_it():
    """One member has the odds by itself; the others are as probable but for less than the odds."""
    best, second = Known(SINGLE + NAMED_ODDS + 0.1), {"value": SINGLE + NAMED_ODDS - 1.0}
    pair = 40.0 + PAIR - SINGLE + NAMED_ODDS
    for less, members in ((0.0, ("coulomb", "preload")), (1.0, ("coulomb",))):  # with no more structure than the form
        limited = Known(**second, limited=second["value"] - less)
        trials = {"coulomb": trial("coulomb", best), "preload": trial("preload", limited)}
        assert judged(trials).members == members
    pairs = {"coulomb+preload": pair + 0.1, "coulomb+rayleigh": pair - 1.0, "presliding+rayleigh": pair - NAMED_ODDS}
    trials = {name: trial(name, Known(value), rms=0.9) for name, value in pairs.items()}
    trials["coulomb"] = trial("coulomb", Known(40.0))
    assert judged(trials).members == ("coulomb+preload", "coulomb+rayleigh")


def test_a_second_effect_explains_more_than_the_form_of_the_model_may_leave():
    """Of a misfit of ten noises the form may leave half a noise beside the first effect."""
    for rms, best in ((0.80, "coulomb+preload"), (0.88, "coulomb")):  # 0.6 and 0.47 are explained
        pair, single = trial("coulomb+preload", Known(80.0), rms=rms), trial("coulomb", Known(40.0))
        selection = judged({"coulomb": single, "coulomb+preload": pair}, base_rms=0.5 / FORM)
        assert selection.best_model == best
        fitter = SimpleNamespace(problem=SimpleNamespace(data=SimpleNamespace(block=np.arange(24))))
        assert Judge(fitter, np.ones(24, bool), TRIED).chosen_without(selection, 0) == best


def test_a_pair_of_which_one_size_may_be_zero_leaves_the_single_effect():
    pair = trial("coulomb+preload", Known(80.0, distance={"coulomb": 5.0, "preload": 0.5}), rms=0.9)
    selection = judged({"coulomb": trial("coulomb", Known(40.0)), "coulomb+preload": pair})
    assert selection.best_model == "coulomb+preload"
    assert selection.members == ("coulomb",)


def test_a_pair_near_the_best_one_is_not_named_where_the_best_single_effect_is_as_probable():
    """The best pair is refused; the next is no more probable than its first effect alone, by the odds."""
    pairs = 40.0 + PAIR - SINGLE
    refused = Known(pairs + NAMED_ODDS + 1, distance={"coulomb": 5.0, "preload": 0.5})
    trials = {
        "coulomb": trial("coulomb", Known(40.0)),
        "coulomb+preload": trial("coulomb+preload", refused),
        "coulomb+rayleigh": trial("coulomb+rayleigh", Known(pairs + NAMED_ODDS - 0.1)),
    }
    assert judged(trials).members == ("coulomb",)


@pytest.mark.parametrize("value", [38.0, 41.0])
def test_a_class_has_models_that_are_as_probable_with_a_discrepancy_beside_them(value):
    """A creep 2 nats behind a creep of the sensor was left out for the discrepancy, so that this was named alone."""
    with_discrepancy = trial("creep", Known(value, limited=30.0))
    assert judged({"creep": with_discrepancy}).members == ()
    selection = judged({"torque_creep": trial("torque_creep", Known(40.0)), "creep": with_discrepancy})
    assert set(selection.members) == {"creep", "torque_creep"}
    far = {"torque_creep": trial("torque_creep", Known(48.0)), "creep": with_discrepancy}
    assert judged(far).members == ("torque_creep",)


def test_models_within_the_odds_are_one_class():
    trials = {
        "coulomb": trial("coulomb", Known(40.0)),
        "presliding": trial("presliding", Known(40.0 - NAMED_ODDS + 0.01)),
        "rayleigh": trial("rayleigh", Known(40.0 - NAMED_ODDS - 0.01)),
    }
    assert judged(trials).members == ("coulomb", "presliding")
    assert judged(trials).nearest_model == "rayleigh"


@pytest.mark.parametrize("rms", [1.5, 15.0, 45.0])
def test_an_effect_is_not_named_while_structure_is_left_however_much_it_removes(rms):
    selection = judged({"coulomb": trial("coulomb", Known(value=400.0, limited=-400.0), rms=rms)}, base_rms=50.0)
    assert selection.best_model == "coulomb"
    assert selection.members == ()


def test_a_refused_name_stays_the_nearest_with_its_reason():
    selection = without_names(judged({"coulomb": trial("coulomb", Known(40.0))}), "unused data are missed")
    assert selection.members == ()
    assert selection.best_model == selection.nearest_model == "coulomb"
    assert selection.reasons["coulomb"] == "unused data are missed"


def test_what_the_form_may_leave_grows_with_the_misfit():
    assert form_limit(1.0) == pytest.approx(np.hypot(0.75, 0.05))
    assert form_limit(40.0) == pytest.approx(np.hypot(0.75, 2.0))


DATA = replace(
    linear_data(positions=3, cycles=2, branches=2, cells=8, sigma=0.1),
    torque=np.tile(np.concatenate([np.linspace(-5, 5, 8), np.linspace(5, -5, 8)]), 6),
)


def verdict_on(angle, designs, data=DATA):
    """What is judged of a linear unit, each effect with a column of its own."""
    cells = np.ones(len(data), bool)
    data = replace(data, angle=angle)
    covariance = Covariance(data, cells, parts_of(data, cells))
    trials = {}
    for name, column in {"": None, **designs}.items():
        columns = np.ones((len(data), 0)) if column is None else column[:, None]
        fitter = LinearFitter(data, columns)
        fitter.problem.record = {}
        model = Model((candidates()[name],)) if name else model_of(0)
        fit = fitter.fit(model, cells, fitter.start(model))
        misfit = (angle - fit.predicted_angle) / data.sigma
        misfit -= (np.bincount(data.group, misfit) / np.bincount(data.group))[data.group]
        trials[name] = Trial(fit, Evidence(covariance, fitter, fit), float(np.sqrt(np.mean(misfit**2))))
    return Judge(fitter, cells, len(designs)).select(trials.pop(""), trials, {})


@pytest.mark.parametrize(("units", "few"), [pytest.param(100, 5, marks=pytest.mark.attack), (20, 3)])
@pytest.mark.long
def test_an_effect_is_named_on_at_most_a_few_of_many_empty_units_and_on_all_that_have_it(units, few):
    rng = np.random.default_rng(2)
    names = ("coulomb", "output_torsion", "torque_zero", "torque_gain")
    empty = present = 0
    for _ in range(units):
        designs = {name: rng.normal(size=len(DATA)) for name in names}
        noise = 0.1 * rng.standard_normal(len(DATA))
        empty += bool(verdict_on(noise, designs).members)
        present += verdict_on(noise + 0.08 * designs["coulomb"], designs).members == ("coulomb",)
    assert empty <= few
    assert present >= units - few


def test_an_effect_is_not_named_for_a_law_that_it_only_resembles():
    """Lenses explain most of a loop with bulges, and leave these: more than the form of a model does."""
    noise = 0.1 * np.random.default_rng(5).standard_normal(len(DATA))
    lens, bulges = DATA.senses * (1 - (DATA.torque / 5) ** 2), DATA.senses * np.cos(np.pi * DATA.torque / 2)
    lens, bulges = (shape / np.sqrt(np.mean(shape**2)) for shape in (lens, bulges))
    assert verdict_on(noise + 0.3 * lens, {"rayleigh": lens}).members == ("rayleigh",)
    selection = verdict_on(noise + 0.3 * (np.sqrt(1 - 0.3**2) * lens + 0.3 * bulges), {"rayleigh": lens})
    assert selection.best_model == "rayleigh"
    assert selection.members == ()
    assert "discrepancy" in selection.reasons["rayleigh"]


@pytest.mark.parametrize(("left", "is_named"), [(0.3, True), (0.6, False)])
def test_beside_a_name_is_left_what_units_without_an_effect_leave_and_no_more(left, is_named):
    """Bulges of some noise beside a lens, in as many cells as a unit has."""
    data = linear_data(positions=3, cycles=4, branches=2, cells=24, sigma=0.1)
    data = replace(data, torque=np.tile(np.concatenate([np.linspace(-5, 5, 24), np.linspace(5, -5, 24)]), 12))
    lens, bulges = data.senses * (1 - (data.torque / 5) ** 2), data.senses * np.cos(np.pi * data.torque / 2)
    bulges /= np.sqrt(np.mean(bulges**2))
    angle = 0.1 * np.random.default_rng(5).standard_normal(len(data)) + 0.2 * lens + 0.1 * left * bulges
    assert bool(verdict_on(angle, {"rayleigh": lens}, data).members) == is_named


@pytest.mark.parametrize("misfit", [0.0, 1.0, 2.0])
def test_cycles_may_differ_beside_a_name_by_a_tenth_of_the_noise_but_not_by_two(misfit):
    """A thermal growth of 80 nats was refused for a tenth that its 3,793 cells showed by 3 nats."""
    alike, between_cycles = limits_beside_name(misfit)
    assert SIZES[1] <= between_cycles < SIZES[2] < SIZES[3] <= alike < SIZES[4]


def test_an_effect_is_not_named_while_what_it_leaves_differs_between_cycles():
    """Friction of another size in each cycle, whose mean is constant friction; noise of the branches hides nothing."""
    noise = 0.1 * np.random.default_rng(5).standard_normal(len(DATA))
    friction = DATA.senses * 1.0
    sizes = {"alike": np.ones(2), "by cycle": np.array([1.3, 0.7])}
    selections = {
        name: verdict_on(noise + 0.4 * size[DATA.cycle] * friction, {"coulomb": friction})
        for name, size in sizes.items()
    }
    assert selections["alike"].members == ("coulomb",)
    assert selections["alike"].trials["coulomb"].evidence.structure.cycle_size <= SIZES[1]
    by_cycle = selections["by cycle"]
    assert by_cycle.best_model == "coulomb"
    assert by_cycle.members == ()
    assert "discrepancy" in by_cycle.reasons["coulomb"]


def test_of_several_solutions_the_most_probable_counts_and_those_within_the_odds_are_kept():
    """A solution of 50 by what its derivatives promise has 4 at its fit and is not the most probable one."""
    solutions = [trial("coulomb", Known(value)) for value in (5.0, 9.0, 9.0 - 0.9 * ODDS, 9.0 - 1.1 * ODDS)]
    solutions.append(trial("coulomb", Known(50.0, promise=46.0)))
    result = most_probable(solutions)
    assert result.evidence.value == 9.0
    assert [other.evidence.value for other in result.other_solutions] == [9.0 - 0.9 * ODDS]


def test_a_pair_whose_fall_is_the_least_has_just_the_odds_over_a_single_effect():
    half = 0.5 * least_fall(2, TRIED, 1)
    assert half + prior_log_odds(2, TRIED) - prior_log_odds(1, TRIED) == pytest.approx(NAMED_ODDS)


def test_what_leads_with_no_more_beside_it_than_the_form_leaves_is_fitted_from_all_starts(monkeypatch):
    """A discrepancy takes up what a fit that ended early leaves, so that another effect may lead by it."""
    known = {"coulomb": Known(90.0, limited=-50.0), "presliding": Known(70.0), "preload": Known(10.0)}
    trials = {name: trial(name, evidence) for name, evidence in known.items()}
    selection, fitted, selector = judged(trials), [], Selector.__new__(Selector)
    unsound = SimpleNamespace(sound=False, model=Model(), cost=np.inf)
    selector.fitter = SimpleNamespace(fit=lambda model, *_, **__: fitted.append(model.name) or unsound)
    monkeypatch.setattr(model_selection, "start_from_declared", lambda *_: None)
    cells = np.ones(24, bool)
    problem = SimpleNamespace(data=SimpleNamespace(block=np.arange(24)), record={"time": 9.0, "cycles": 9.0})
    fitter = SimpleNamespace(problem=problem, bounds=lambda model: [(-2.0, 8.0)] * model.n_parameters)
    tries = Tries(cells, None, Judge(fitter, cells, TRIED))
    promises = {name: SimpleNamespace(starts=(None,)) for name in known}
    selector._with_all_solutions(selection, promises, tries)
    assert set(fitted) == {"coulomb", "presliding"}
    refined: list[str] = []
    selector.fitter.refine = lambda fit, *_: refined.append(fit.model.name) or fit
    selector.trial = lambda fit, *_: trials[fit.model.name]
    selector._with_refined_fits(selection, tries)
    assert set(refined) == {"coulomb", "presliding"}


def test_a_fit_that_misses_many_times_as_much_as_the_best_is_not_refined():
    """Its passes would take seconds; beyond three times the best sum of squares fits end early elsewhere, too."""
    costs = {"coulomb": (9000.0, 24.0), "presliding": (8985.0, 60.0), "rayleigh": (100.0, 20_000.0)}
    trials = {name: trial(name, Known(value)) for name, (value, _) in costs.items()}
    trials = {name: replace(one, fit=replace(one.fit, cost=costs[name][1])) for name, one in trials.items()}
    refined, selector = [], Selector.__new__(Selector)
    selector.fitter = SimpleNamespace(refine=lambda fit, *_: refined.append(fit.model.name) or fit)
    selector.trial = lambda fit, *_: trials[fit.model.name]
    problem = SimpleNamespace(data=SimpleNamespace(block=np.arange(24)), record={"time": 9.0, "cycles": 9.0})
    fitter = SimpleNamespace(problem=problem, bounds=lambda model: [(-2.0, 8.0)] * model.n_parameters)
    cells = np.ones(24, bool)
    selector._with_refined_fits(judged(trials), Tries(cells, None, Judge(fitter, cells, TRIED)))
    assert set(refined) == {"coulomb", "presliding"}


def test_a_rival_whose_fit_is_far_from_its_most_probable_unknowns_is_predicted_there_too():
    """Its linear evidence may be too small by as much as it promises, or by 25 nats; one that lacks more stays behind.

    So does one that is a thousand behind, whatever it promises: a linear problem far from the data promises anything.
    """
    known = {"coulomb": Known(60.0), "presliding": Known(35.0, promise=22.0), "creep": Known(25.0, promise=5.0)}
    known |= {"coulomb+creep": Known(30.0, promise=30.0), "flank_wear": Known(-900.0, promise=5000.0)}
    known["rayleigh"] = Known(40.0, promise=2.0)
    trials = {name: trial(name, evidence) for name, evidence in known.items()}
    selection, asked, selector = judged(trials), [], Selector.__new__(Selector)
    problem = SimpleNamespace(data=SimpleNamespace(block=np.arange(24)), record={"time": 9.0, "cycles": 9.0})
    fitter = SimpleNamespace(problem=problem, bounds=lambda model: [(-2.0, 8.0)] * model.n_parameters)
    tries = Tries(np.ones(24, bool), None, Judge(fitter, np.ones(24, bool), TRIED))

    def at_most_probable(one):
        asked.append(one.fit.model.name)
        evidence = one.evidence
        return replace(one, evidence=Known(evidence.value + evidence.promise, gain=evidence.predictive[0]))

    selector.at_most_probable = at_most_probable
    selector._fit_without_effects = lambda *_: SimpleNamespace(sound=False)
    predicted = selector._at_their_most_probable(selection, tries)
    assert selection.members == ("coulomb",)
    assert sorted(asked) == ["", "coulomb", "presliding", "rayleigh"]
    assert predicted.members == ("coulomb", "presliding")


@pytest.mark.parametrize(("values", "chosen"), [((5.0, 9.0), 1), ((9.0, 5.0), 0)])
def test_the_fit_without_effects_is_the_more_probable_of_two_though_it_misses_more(values, chosen):
    ends = [replace(trial("", Known(value)).fit, cost=cost) for value, cost in zip(values, (10.0, 20.0), strict=True)]
    selector, refined = Selector.__new__(Selector), iter(ends)
    start = SimpleNamespace(unknowns=None)
    selector.fitter = SimpleNamespace(
        start=lambda _: None, fit_by_load=lambda *_: start, refine=lambda *_: next(refined)
    )
    selector.tries = lambda _: Tries(None, None, None)
    selector.trial = lambda fit, *_: Trial(fit, Known(values[int(fit is ends[1])]), 1.0)
    selector.at_most_probable = lambda one: one
    assert selector.recalibrate(np.ones(3, bool)) is ends[chosen]
    refined = iter(ends)
    assert selector.recalibrate(np.ones(9, bool)) is ends[chosen]
    refined = iter(ends)
    assert selector.recalibrate(np.ones(10, bool)) is ends[0]  # it misses no more than noise
    assert next(refined) is ends[1]


@pytest.mark.parametrize(("value", "is_named"), [(30.0, True), (59.0, False)])
def test_no_effect_is_named_by_where_its_steps_led(value, is_named):
    """The model without effects may be as probable there as with the effect, though its own fit ended elsewhere."""
    selection, selector = judged({"coulomb": trial("coulomb", Known(60.0))}), Selector.__new__(Selector)
    problem = SimpleNamespace(data=SimpleNamespace(block=np.arange(24)), record={"time": 9.0, "cycles": 9.0})
    fitter = SimpleNamespace(problem=problem, bounds=lambda model: [(-2.0, 8.0)] * model.n_parameters)
    selector.at_most_probable = lambda one: one
    selector._fit_without_effects = lambda *_: SimpleNamespace(sound=True)
    selector.trial = lambda *_: trial("", Known(value, gain=0.0))
    predicted = selector._at_their_most_probable(
        selection, Tries(np.ones(24, bool), None, Judge(fitter, np.ones(24, bool), TRIED))
    )
    assert selection.members
    assert bool(predicted.members) == is_named
    assert predicted.base.evidence.value == value


@pytest.mark.parametrize(
    ("odds", "promise", "n_drawn", "n_refined"),
    [(20.0, 0.0, 6, 7), (60.0, 0.0, 0, 1), (300.0, 0.0, 0, 0), (300.0, 150.0, 0, 1)],
)
def test_a_close_name_is_held_against_fits_without_effects_from_drawn_unknowns(odds, promise, n_drawn, n_refined):
    """One that is further ahead than any other start or step leads is not held against further ones.

    What the linear problem promises of the model without effects may be all of the odds, if steps led nowhere.
    """
    selection, selector = judged({"coulomb": trial("coulomb", Known(odds + SINGLE))}), Selector.__new__(Selector)
    base, started, refined = selection.base, [], []
    base.evidence.promised_value += promise
    base.evidence.drawn = lambda count: [np.full(len(base.fit.unknowns.flat), 0.1 * k) for k in range(count)]
    selector.fitter = SimpleNamespace(
        fit_by_load=lambda model, cells, start: started.append(start) or base.fit,
        refine=lambda fit, *_: refined.append(fit) or fit,
    )
    steps: list[int] = []
    selector._fit_without_effects = lambda fit, cells, n_steps=15: steps.append(n_steps) or base.fit
    selector.trial = lambda *_: trial("", Known(odds))
    selector.at_most_probable = lambda one: one
    found = selector._without_effects(selection, np.ones(3, bool))
    assert (len(started), len(refined)) == (n_drawn, n_refined)
    assert steps == [15] * bool(n_refined)  # from the leading model, to the end
    assert (found.evidence.value > base.evidence.value) == bool(n_refined)


def test_beside_a_new_base_only_close_effects_are_tried_where_nothing_was_named():
    """``preload`` lacks two nats, ``coulomb`` thirty, and the base has gained five."""
    selection = SimpleNamespace(odds={"preload": NAMED_ODDS - 2, "coulomb": NAMED_ODDS - 30})
    assert _close_effects(selection, 5.0) == {"preload"}


@pytest.mark.parametrize(("odds", "is_tried_anew"), [(-2.0, False), (3.0, False), (5.0, True), (60.0, True)])
def test_everything_is_tried_anew_beside_a_new_base_only_where_its_gain_could_decide(odds, is_tried_anew):
    """Of effects that lack more than the three nats which the base has gained, none could be named beside it."""
    selection, selector = judged({"coulomb": trial("coulomb", Known(odds + SINGLE))}), Selector.__new__(Selector)
    new_base, bases = trial("", Known(3.0, gain=0.0)), []
    selector._beside = lambda base_fit, *_: bases.append(base_fit) or selection
    selector._without_effects = lambda *_: new_base
    challenged = replace(selection, base=new_base, members=())
    judge = SimpleNamespace(select=lambda base, *_: challenged if base is new_base else None)
    selector.tries = lambda cells: SimpleNamespace(judge=judge)
    selector.recalibrate = lambda cells: selection.base.fit
    found = selector.select(np.ones(3, bool))
    assert [fit is new_base.fit for fit in bases] == [False, True][: 1 + is_tried_anew]
    assert (found is challenged) != is_tried_anew


class Bending(LinearFitter):
    """A model that bends away: its effect moves the angle by its column up to a small size, and no further."""

    def predict(self, model, unknowns, positions=None, modes=False):
        bent = replace(unknowns, shares=np.minimum(unknowns.shares, 0.01))
        return super().predict(model, bent, positions, modes)


@pytest.mark.parametrize(("fitter_class", "is_named"), [(LinearFitter, True), (Bending, False)])
def test_an_effect_is_not_named_for_a_size_at_which_the_model_bends_away(fitter_class, is_named):
    """Near no effect its column promises what is there; about the size that this takes it has none."""
    column = np.random.default_rng(5).normal(size=len(DATA))
    cells, noise = np.ones(len(DATA), bool), 0.1 * np.random.default_rng(6).standard_normal(len(DATA))
    data = replace(DATA, angle=noise + 0.3 * column)
    covariance = Covariance(data, cells, parts_of(data, cells))
    fitter = fitter_class(data, column[:, None])
    fitter.problem.record = {}
    selector = Selector.__new__(Selector)
    selector.fitter, selector.problem = fitter, fitter.problem
    base = selector.trial(fitter.fit(model_of(0), cells, fitter.start(model_of(0))), covariance)
    model = Model((candidates()["coulomb"],))
    near_zero = stood(fitter, model, fitter.start(model, np.zeros(1)), data.sigma)
    trials = {"coulomb": selector.trial(near_zero, covariance)}
    judge = Judge(fitter, cells, 1)
    promised = judge.select(base, trials, {})
    assert promised.best_model == "coulomb"
    selection = selector._at_their_most_probable(promised, Tries(cells, covariance, judge))
    assert bool(selection.members) == is_named
    promise = trials["coulomb"].evidence.value - selection.trials["coulomb"].evidence.value
    assert (promise < 0.1) == is_named
    assert selection.trials["coulomb"].fit is near_zero
    assert not selection.base.evidence.counts_promise


class Steep(LinearFitter):
    """A model whose effect acts within a narrow range of sizes: away from it the whole linear step leads too far."""

    def predict(self, model, unknowns, positions=None, modes=False):
        steep = replace(unknowns, shares=np.arctan(40 * (unknowns.shares - 0.2)) / 40)
        return super().predict(model, steep, positions, modes)


@pytest.mark.parametrize("share", [0.12, 0.25, 0.3])
def test_the_most_probable_unknowns_are_found_from_a_fit_that_ended_elsewhere(share):
    """Against the largest density over a grid of sizes; a step to where the linear problem has it is far off."""
    column = np.random.default_rng(5).normal(size=len(DATA))
    cells, noise = np.ones(len(DATA), bool), 0.02 * np.random.default_rng(6).standard_normal(len(DATA))
    data = replace(DATA, angle=noise, sigma=np.full(len(DATA), 0.02))
    fitter, model = Steep(data, 40 * column[:, None]), model_of(1)
    selector = Selector.__new__(Selector)
    selector.fitter, selector.problem = fitter, fitter.problem
    there = fitter.fit_at(fitter.fit(model, cells, fitter.start(model), 0), np.array([share]), cells)
    trial_there = selector.trial(there, Covariance(data, cells, parts_of(data, cells)))
    found = selector.at_most_probable(trial_there)
    evidence = found.evidence
    shares = np.linspace(0.15, 0.25, 401)
    densities = [evidence.log_density(fitter.fit_at(there, np.array([one]), cells)) for one in shares]
    assert evidence.fit.unknowns.shares[0] == pytest.approx(shares[np.argmax(densities)], abs=1e-3)
    assert evidence.value > trial_there.evidence.without_promise().value + 3
    whole_step = fitter.fit_at(there, trial_there.evidence.most_probable, cells)
    assert abs(whole_step.unknowns.shares[0] - 0.2) > 0.5 * abs(share - 0.2)
    assert found.fit is evidence.fit
    assert found.rms < 1.1 < trial_there.rms
    assert evidence.covariance.rms(data.angle) == 0.0
