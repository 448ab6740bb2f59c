"""The first screen: a card for each limit, the worst yield first, and the limit that fails with what drives it."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from tiny_pages import tiny_study, written

from pipeline.config.studies.study import ALL_LIMITS, Limits, PublishedUnit
from pipeline.figures.labels import METRICS
from pipeline.report import explorer
from pipeline.report.frames import Frames
from pipeline.report.layout import percent
from pipeline.report.results import Results
from pipeline.report.sections.drivers import REMOVED_VARIANCES, main_contributor, share_note, share_notes
from pipeline.report.sections.results import ESTIMATES, ConvergenceTable
from pipeline.report.sections.summary import Verdict
from pipeline.report.single_changes import SCALED_YIELDS, SingleChanges, next_target
from pipeline.statistics.intervals import pass_share


def limited(frames: Frames, limits: Limits) -> Frames:
    """The frames with other limits, and the yields against those."""
    values = frames.over_turn
    kept = limits.pass_flags({name: values[name].to_numpy() for name in values})
    rows = [
        {"metric": name, "over": "worst", "crank_deg": np.nan, "statistic": "yield", **vars(pass_share(passes, 0.95))}
        for name, passes in kept.items()
    ]
    others = frames.distributions[frames.distributions["statistic"] != "yield"]
    study = frames.study.model_copy(update={"limits": limits})
    return replace(frames, study=study, distributions=pd.concat([others, pd.DataFrame(rows)]))


def failing_on_pressure(frames: Frames) -> Frames:
    """Four of twelve units break the limit on pressure, one of them that on lost motion too; none breaks another."""
    pressure, lost_motion = (np.sort(frames.over_turn[name]) for name in ("peak_pressure_MPa", "lost_motion_arcmin"))
    first = frames.over_turn["peak_pressure_MPa"].idxmax()
    lost = frames.over_turn["lost_motion_arcmin"].where(frames.over_turn.index == first, lost_motion[0])
    units = frames.units.assign(lost_motion_arcmin_worst=frames.units["sample"].map(lost))
    limits = Limits(
        clearance_backlash_arcmin=99.0,
        lost_motion_arcmin=(lost_motion[0] + lost[first]) / 2,
        peak_pressure_MPa=(pressure[-5] + pressure[-4]) / 2,
    )
    shares = pd.DataFrame(
        [
            ("pin_tangential", "total", 0.94, 0.9, 0.98),
            ("pin_radial", "total", 0.05, 0.04, 0.06),
            ("pin_tangential", "first_order", 0.51, 0.4, 0.62),
        ],
        columns=["parameter", "kind", "index", "ci_low", "ci_high"],
    ).assign(metric="peak_pressure_MPa", over="worst", n=400)
    sensitivity = pd.concat([frames.sensitivity, shares])
    return limited(replace(frames, units=units, sensitivity=sensitivity), limits)


def test_every_limit_has_a_card_and_the_worst_yield_stands_first(frames):
    page = written(failing_on_pressure(frames))
    cards = re.search(r'<div class="headlines">(.*?)\n</div>\n\n?<p class="answer">', page, re.DOTALL)[1]
    titles = re.findall(r'<p class="title"><a [^>]*>([^<]*)</a>', cards)
    assert titles == [
        METRICS[name].title for name in ("peak_pressure_MPa", "lost_motion_arcmin", "clearance_backlash_arcmin")
    ]
    n_named = cards.count("main contributor: <b>")
    n_not_named = cards.count("no main contributor is determined; state base_samples under [drivers]")
    assert n_not_named == len(titles) - n_named
    assert re.findall(r'<p class="big">([\d.]+ %)', cards) == ["66.7 %", "91.7 %", "100 %"]
    assert "main contributor: <b>tangential pin position (94.0 % of its variance, interactions included)</b>" in cards


def test_one_sentence_names_the_limit_that_fails_and_its_driver(frames):
    page = written(failing_on_pressure(frames))
    interval = pass_share(np.arange(12) < 4, 0.95)
    assert (
        f"33.3 % of the units fail (95 % CI {100 * interval.ci_low:.1f} to {100 * interval.ci_high:.1f} %); 100 % of "
        "these on peak Hertz pressure; its main contributor is the tangential pin position (94.0 % of its variance, "
        "interactions included)."
    ) in page


def test_a_rank_correlation_names_no_main_contributor_and_removed_variance_does(frames):
    """Ranks see pins by their mean alone: an eccentricity of -0.12 stood before pins of half of the variance."""
    ranks = pd.DataFrame(
        [("eccentricity_um", "rank_correlation", -0.9, -0.95, -0.8)],
        columns=["parameter", "kind", "index", "ci_low", "ci_high"],
    ).assign(metric="lost_motion_arcmin", over="worst", n=400)
    ranked = replace(frames, sensitivity=ranks)
    assert main_contributor(ranked, "lost_motion_arcmin") == ""
    assert share_note(ranked, "lost_motion_arcmin") == ""
    rows = [("pin_radial", 0.1, -0.1, 0.3), ("pin_tangential", 0.53, 0.4, 0.6), ("disk_profile", 0.2, 0.1, 0.3)]
    removed = pd.DataFrame(rows, columns=["tolerance", "value", "ci_low", "ci_high"])
    removed = removed.assign(metric="lost_motion_arcmin", n=60)
    solved = replace(ranked, tables={REMOVED_VARIANCES: removed})
    assert main_contributor(solved, "lost_motion_arcmin") == (
        "tangential pin position (tightened to a quarter, it removes 53.0 % of the variance)"
    )
    assert "over 60 units solved again with the tangential pin position" in share_note(solved, "lost_motion_arcmin")
    assert "less by 53.0 % (40.0 to 60.0 %)" in share_note(solved, "lost_motion_arcmin")
    total = ranks.assign(parameter="pin_tangential", kind="total", index=0.9, ci_low=0.8, ci_high=0.95)
    total = total.assign(metric="peak_pressure_MPa")
    both = replace(solved, sensitivity=pd.concat([ranks, total]))
    notes = share_notes(both, ["peak_pressure_MPa", "lost_motion_arcmin", "lost_motion_arcmin"])
    assert [note.split(" counts")[0].split(":")[0] for note in notes] == [
        "A share with interactions included",
        "Removed variance",
    ]
    unsure = replace(ranked, tables={REMOVED_VARIANCES: removed.assign(ci_low=-0.1)})
    assert main_contributor(unsure, "lost_motion_arcmin") == ""


def test_units_without_a_value_are_counted_in_the_first_screen(frames):
    """Units whose play is beyond the model's range are the worst ones: without them the yield is too good."""
    failing = failing_on_pressure(frames)
    assert Verdict(failing, Results(failing)).not_counted == ""
    lost = failing.over_turn.index[:3]
    is_lost = failing.units["sample"].isin(lost)
    units = failing.units.assign(lost_motion_arcmin_worst=failing.units["lost_motion_arcmin_worst"].mask(is_lost))
    status = failing.metrics["status"].astype(object)
    is_of_lost = failing.metrics["sample"].isin(lost)
    metrics = failing.metrics.assign(status=status.mask(is_of_lost, "clearance too large"))
    part = replace(failing, units=units, metrics=metrics)
    verdict = Verdict(part, Results(part))
    passes = int(np.sum(~verdict.breaks[ALL_LIMITS]))
    assert len(verdict.breaks[ALL_LIMITS]) == 9
    assert verdict.not_counted == (
        "This leaves out 3 of 12 units without a value of a metric that has a limit (most often: clearance too large). "
        f"If all of them failed, the yield would be {percent(passes / 12)}; the lower end of its interval counts them "
        "so."
    )
    assert "If all of them failed" in written(part)


def test_the_next_step_names_limits_that_an_allocation_refuses(frames):
    failing = failing_on_pressure(frames)
    assert "an allocation uses metrics of a loop" not in written(failing)
    limits = failing.study.limits.model_copy(update={"transmission_error_arcsec": 1e6})
    study, units = failing.study.model_copy(update={"limits": limits}), failing.units
    both = replace(failing, study=study, units=units.assign(transmission_error_arcsec=1.0))
    assert "copy of the study without limits.transmission_error_arcsec" in Verdict(both, Results(both)).advice


@pytest.mark.long
def test_the_page_says_which_share_of_the_variance_a_contributor_has(frames):
    failing = failing_on_pressure(frames)
    alone = "by itself the tangential pin position causes 51.0 % (40.0 to 62.0 %) of the variance of the peak Hertz"
    assert f"where tolerances interact: {alone} pressure (first-order index)." in written(failing)
    table = failing.sensitivity
    without = replace(failing, sensitivity=table[table["kind"] != "first_order"])
    assert "making this tolerance alone exact removes less where tolerances interact." in written(without)
    ranks = replace(failing, sensitivity=table[table["kind"] == "rank_correlation"])
    assert "interactions included counts" not in written(ranks)


@pytest.mark.long
def test_the_yield_is_said_to_be_an_upper_bound_before_anything_else(frames):
    summary = written(frames).partition('id="summary"')[2]
    first = re.search(r'<p class="answer">(.*?)</p>', summary, re.DOTALL)[1]
    assert "It counts 2 loaded crank angles; over the whole turn of the output the yield is at most this." in first
    mean = frames.study.limits.model_copy(update={"over": "mean"})
    other = written(replace(frames, study=frames.study.model_copy(update={"limits": mean})))
    assert "at most as many" not in other


@pytest.mark.long
def test_a_study_of_preloaded_units_says_so_first(frames):
    tight = frames.distributions["value"].where(frames.distributions["metric"] != "preloaded", 1.0)
    page = written(replace(frames, distributions=frames.distributions.assign(value=tight)))
    summary = page.partition('id="summary"')[2]
    assert summary.index("100 % of the units are preloaded") < summary.index("meet every limit")
    assert "of the units are preloaded" not in written(frames)


def test_where_no_unit_fails_the_page_bounds_the_failing_share(frames):
    everything = limited(frames, Limits(clearance_backlash_arcmin=99.0))
    high = 1 - pass_share(np.ones(12, bool), 0.95).ci_low
    assert f"No unit of 12 fails a limit; the failing share is at most {100 * high:.1f} %." in written(everything)


def test_without_limits_the_cards_are_those_of_the_headline_metrics(frames):
    page = written(replace(frames, study=frames.study.model_copy(update={"limits": Limits()})))
    assert page.count('<p class="title">') == 3
    assert "The study sets no limits" in page
    assert ALL_LIMITS not in page


def test_the_yield_of_the_whole_turn_stands_before_that_of_the_angles(frames):
    """Where the worst was searched over the output turn: its row of the distributions, and what it rests on."""
    failing = failing_on_pressure(frames)
    row = {"metric": ALL_LIMITS, "over": "whole_turn", "crank_deg": np.nan, "statistic": "yield"}
    rows = pd.DataFrame([{**row, "value": 0.412, "ci_low": 0.308, "ci_high": 0.521, "n": 12, "n_angles": 6320}])
    searched = replace(
        failing, units=failing.units.assign(n_searched=6320), distributions=pd.concat([failing.distributions, rows])
    )
    page = written(searched)
    assert "41.2 %" in page
    assert "58.8 % of the units fail" in page
    assert "It holds for the whole turn of the output." in page
    assert "searched: 6,320 pitches of the pins were ranked" in page
    assert "at most as many" not in page
    assert "whole turn: the search, corrected by the audited units" not in page  # no means
    limits = searched.study.limits.model_copy(
        update={"transmission_error_arcsec": 1e6, "unloaded_transmission_error_arcsec": 1e6}
    )
    of_turn = replace(searched, study=searched.study.model_copy(update={"limits": limits}))
    counts = of_turn.units.iloc[0]
    angles = (
        f"{counts['n_angles']:,} and {counts['n_rigid_angles']:,} crank angles, between which the worst may be larger"
    )
    said = Verdict(of_turn, Results(of_turn)).holds_for
    assert said.startswith("It holds for the whole turn of the output, but for the transmission error")
    assert angles in said
    row |= {"metric": "transmission_error_arcsec", "value": 0.9}
    corrected = replace(of_turn, distributions=pd.concat([of_turn.distributions, pd.DataFrame([row])]))
    assert Results(corrected).estimate("transmission_error_arcsec", "yield")[0] == 0.9
    said = Verdict(corrected, Results(corrected)).holds_for
    assert "but for the transmission error without load: of" in said
    assert f"{counts['n_rigid_angles']:,} crank angles" in said


def test_the_table_of_convergence_ends_with_the_bound_of_the_continuous_turn(frames):
    rows = pd.DataFrame(
        [
            {"metric": metric, "over": over, "crank_deg": np.nan, "statistic": statistic, "value": value}
            for over, size in (("whole_turn", 1.0), ("continuous_turn", 1.1))
            for metric, statistic, value in (
                ("lost_motion_arcmin", "mean", 2.345 * size),
                (ALL_LIMITS, "yield", 0.5 / size),
            )
        ]
    )
    failing = failing_on_pressure(frames)
    bounded = replace(failing, distributions=pd.concat([failing.distributions, rows]))
    table = ConvergenceTable(bounded, Results(bounded))
    labels = [label for label, _ in table.rows]
    assert labels[-2:] == list(ESTIMATES.values())
    assert labels[-3].endswith("loaded angles")
    column = [title for title, _ in table.headings].index("Lost motion")
    cells = [cells for _, cells in table.rows]
    assert [row[column] for row in cells[-2:]] == ["2.35", "2.58"]
    assert [row[-1] for row in cells[-2:]] == ["50.0 %", "45.5 %"]
    assert len({len(row) for row in cells}) == 1
    assert "continuous turn: at worst" in written(bounded)
    bound = "For the continuous turn finitely many angles give no unbiased estimate"
    assert (bound in written(bounded), bound in written(failing)) == (True, False)


def test_the_explorer_holds_the_worst_units(frames, monkeypatch):
    monkeypatch.setattr(explorer, "UNITS_SHOWN", 4)
    monkeypatch.setattr(explorer, "WORST_SHOWN", 2)
    failing = failing_on_pressure(frames)
    shown = explorer.explored_units(failing).index
    assert len(shown) == 4
    assert set(frames.over_turn["peak_pressure_MPa"].nlargest(1).index) <= set(shown)
    without = replace(failing, study=frames.study.model_copy(update={"limits": Limits()}))
    assert explorer.explored_units(without).index.tolist() == [1, 2, 3, 4]


def scaled(frames: Frames, curves: dict[str, list[float]], costs: bool = True) -> SingleChanges:
    """Changes with a table of yields at scales 0.5 and 2, of a study at 80 %."""
    rows = [
        {"tolerance": name, "scale": scale, "metric": ALL_LIMITS, "value": value, "ci_low": value - 0.1,
         "ci_high": min(value + 0.1, 1.0), "n": 12}
        for name, values in curves.items()
        for scale, value in zip((0.5, 2.0), values, strict=True)
    ]  # fmt: skip
    law = {"law": "reciprocal", "cost": 1.0, "tolerance_um": 6.0}
    data = {"costs": {"pin_radial": law, "pin_tangential": {**law, "cost": 9.0}}} if costs else {}
    others = replace(frames, study=tiny_study("tiny", **data), tables={SCALED_YIELDS: pd.DataFrame(rows)})
    return SingleChanges.from_frames(others, (0.8, 0.75, 0.85))


def test_the_cheapest_single_change_that_reaches_the_target_is_named_with_its_cost(frames):
    changes = scaled(frames, {"pin_tangential": [0.95, 0.5], "pin_radial": [0.9, 0.7], "pin_radius": [0.8, 0.8]})
    assert changes.target == 0.9
    assert changes.best_change.tolerance == "pin_radial"  # at half of its limits, for 1; the other at 2/3, for 4.5
    assert changes.best_change.scale == pytest.approx(0.5)
    assert changes.best_change.cost == pytest.approx(1.0)
    assert "tighten the radial pin position alone from −3 to 3 µm to −1.5 to 1.5 µm (0.5 times" in changes.sentence
    assert "so that its middle moves" not in changes.sentence
    one_sided = scaled(frames, {"roller_diameter": [0.95, 0.5]})
    assert "times its limits, so that its middle moves from −1 to −0.667 µm)" in one_sided.sentence
    assert "The cost rises by 1, by the prices under [costs]" in changes.sentence
    assert "This rests on 12 units that were solved again at every scale" in changes.sentence


def test_without_costs_the_least_scaling_is_named(frames):
    changes = scaled(frames, {"pin_tangential": [0.95, 0.5], "pin_radial": [0.9, 0.7]}, costs=False)
    assert changes.best_change.tolerance == "pin_tangential"
    assert changes.best_change.scale == pytest.approx(1 - 0.5 * 0.1 / 0.15)
    assert "The study states no price for it" in changes.sentence


def test_a_target_out_of_reach_of_every_single_change_is_said_so(frames):
    changes = scaled(frames, {"pin_tangential": [0.85, 0.5], "pin_radial": [0.82, 0.7]})
    assert changes.best_change is None
    assert changes.largest_yield_change.tolerance == "pin_tangential"
    assert changes.sentence.startswith("No single tolerance reaches a yield of 90.0 %. The largest estimated gain: ti")
    assert "Its interval contains the present yield: the gain is not significant." in changes.sentence
    sure = replace(changes, stated_yield=(0.7, 0.65, 0.75))
    assert "not significant" not in sure.sentence
    assert "No tolerance, scaled alone" in scaled(frames, {"pin_radial": [0.8, 0.8]}).sentence
    assert scaled(frames, {}).sentence == ""


@pytest.mark.parametrize(("value", "target"), [(0.3, 0.9), (0.9, 0.95), (0.96, 0.99), (0.995, 0.999), (1.0, 0.999)])
def test_the_target_is_the_next_usual_yield(value, target):
    assert next_target(value) == target


def test_a_published_unit_is_beside_the_prediction_and_said_to_lie_outside_of_it(frames):
    values = frames.over_turn["lost_motion_arcmin"]
    units = [
        PublishedUnit(label="inside", source="a paper", lost_motion_arcmin=float(values.median())),
        PublishedUnit(label="outside", source="a paper", note="at 20 C", lost_motion_arcmin=2 * float(values.max())),
    ]
    assert 'id="published"' not in written(frames)
    study = frames.study.model_copy(update={"published": tuple(units)})
    page = written(replace(frames, study=study)).partition('id="published"')[2]
    assert "outside: the measured lost motion is larger than that of every predicted unit" in page
    assert "inside: the measured" not in page
    assert "outside: at 20 C. Source: a paper." in page
    shares = re.findall(r'data-label="Predicted units below">([^<]*)<', page)
    assert shares == [percent(float((values < values.median()).mean())), "100 %"]


@pytest.mark.parametrize(
    ("share", "text"),
    [
        (1.0, "100 %"),
        (0.0, "0.0 %"),
        (0.9996, "99.96 %"),
        (0.99996, "99.996 %"),
        (0.004, "0.4 %"),
        (0.00004, "0.004 %"),
    ],
)
def test_a_share_is_rounded_to_0_or_100_percent_only_where_it_is_that(share, text):
    assert percent(share) == text


@pytest.mark.parametrize(("value", "text"), [(1.8591, "1.86"), (0.12441, "0.124"), (12.345, "12.3"), (3917.4, "3,917")])
def test_numbers_have_three_digits(value, text):
    assert METRICS["lost_motion_arcmin"].text(value) == text


def test_where_no_contributor_is_determined_the_page_says_what_would_determine_it(frames):
    def said(with_frames: Frames) -> str:
        return Verdict(with_frames, Results(with_frames)).no_contributor

    frames = limited(frames, Limits(lost_motion_arcmin=99.0))
    assert "; state base_samples under [drivers]" in said(frames)
    asked = frames.study.model_copy(update={"drivers": frames.study.drivers.model_copy(update={"base_samples": 64})})
    assert "; state more base_samples under [drivers]" in said(replace(frames, study=asked))
    assert "from 4 units; run 10 or more" in said(replace(frames, units=frames.units.iloc[:5]))
    alike = frames.study.model_copy(update={"tolerances": type(frames.study.tolerances)()})
    assert said(replace(frames, study=alike)) == "no tolerance contributes, since none varies"
