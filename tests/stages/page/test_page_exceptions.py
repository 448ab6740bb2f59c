"""Pages of studies with failed samples, without limits or results, and of listed cases; the order of the stages."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from tiny_pages import STAGES_RUN, cells, frames_of, tiny_study, written

from pipeline.config.studies.study import Limits
from pipeline.engine.runner import Resources, run
from pipeline.figures.labels import METRICS
from pipeline.report.frames import Frames
from pipeline.report.layout import percent
from pipeline.report.sections.reference import BOX, GAP, overload_phrases, ranges, stage_graph
from pipeline.report.sections.results import case_rows
from pipeline.report.sections.section import drawings
from stages.chain import STAGES

FAILURE = "no equilibrium at <3> N m: residual 1e-3"


def test_stages_stand_right_of_what_they_read():
    graph = stage_graph(STAGES_RUN)
    assert [stage.x for stage in graph.boxes] == [0, BOX[0] + GAP[0], 2 * (BOX[0] + GAP[0])]
    assert len(graph.lines) == 2  # what hysteresis reads of sample goes by clearance too
    assert [stage.share for stage in graph.boxes] == pytest.approx([1 / 8, 2 / 8, 5 / 8])
    assert "clearance reads sample: 2.0 s, 3 items failed" in graph.description
    assert [stage.note.state for stage in graph.boxes] == ["10 done", "3 of 10 failed", "nothing asked for"]


def failing(frames: Frames, rows: list[int]) -> Frames:
    """The frames with load cycles that have no result."""
    lost_motion = np.isin(np.arange(len(frames.metrics)), rows)
    status = np.where(lost_motion, FAILURE, "ok")
    metrics = frames.metrics.assign(status=status)
    metrics.loc[lost_motion, list(METRICS)] = np.nan
    units = frames.units.assign(status=np.where(lost_motion.reshape(-1, 2).any(axis=1), FAILURE, "ok"))
    units.loc[units["status"] != "ok", [f"{name}_worst" for name in METRICS]] = np.nan
    return replace(frames, metrics=metrics, units=units)


def test_failed_samples_are_listed_with_their_reasons_and_left_out_of_bands(frames):
    candidate = failing(frames, [0, 7])
    text = written(candidate)
    assert "2 of 26 load cycles have no result; they belong to 2 samples" in text
    assert "no equilibrium at &lt;3&gt; N m: residual 1e-3" in text
    assert "nominal reducer" in text
    assert 3 not in candidate.band
    assert len(candidate.band) == 11
    assert candidate.samples_drawn == {}
    assert "keeps the contacts of none of the drawn samples" in text
    names = [drawing.name for drawing in drawings(candidate)]
    assert "hysteresis" in names
    assert "pin_loads" not in names


def test_report_of_a_study_without_any_result(frames):
    no_effect = failing(frames, list(range(26)))
    no_effect = replace(
        no_effect, distributions=frames.distributions[:0], sensitivity=frames.sensitivity.assign(index=np.nan)
    )
    text = written(no_effect)
    assert "No sample has a result" in text
    assert "Not determined: no sample has a result." in text
    assert [drawing.name for drawing in drawings(no_effect)] == [
        "reducer",
        "spring_laws",
        "clearances",
        "bearing",
        "hysteresis",
    ]


def test_a_metric_that_holds_for_no_sample_has_no_picture(frames):
    """Friction above the torque of the lost motion: the other metrics stand, over the turn and at each angle."""
    name = "lost_motion_arcmin"
    without_effect = frames.distributions[~frames.distributions["metric"].isin([name, "all_limits"])]
    units = frames.units.assign(**{f"{name}_{statistic}": np.nan for statistic in ("worst", "mean", "best")})
    stuck = replace(frames, metrics=frames.metrics.assign(**{name: np.nan}), units=units, distributions=without_effect)
    assert {"distributions", "cranks"} <= {drawing.name for drawing in drawings(stuck)}
    assert "No sample has a result" not in written(stuck)


def test_no_limits_no_yield(frames):
    free = replace(frames, study=frames.study.model_copy(update={"limits": Limits()}))
    text = written(free)
    assert "Yield</th>" not in text
    assert "The study sets no limits" in text
    assert "All limits together" not in text


def test_contacts_beyond_the_pressure_limit_are_named(frames):
    tight = replace(frames, study=frames.study.model_copy(update={"limits": Limits(peak_pressure_MPa=0.001)}))
    nominal = frames.loads[(frames.loads["sample"] == 0) & (frames.loads["crank_deg"] == 0.0)]
    loads = nominal[nominal["pressure_MPa"] > 0.001]
    pins = sorted(loads.loc[loads["contact"] < 80, "contact"].unique())
    (sentence,) = overload_phrases(tight)
    assert sentence.startswith(f"{len(pins)} pins ({ranges(pins)}) and ")
    assert sentence.endswith("of the nominal reducer")
    loose = replace(frames, study=frames.study.model_copy(update={"limits": Limits(peak_pressure_MPa=1e6)}))
    assert overload_phrases(loose) == ["none of the nominal reducer"]
    assert ranges([3, 70, 71, 72, 75, 76]) == "3, 70–72, 75–76"


def test_the_page_shows_what_the_limits_are_of(frames):
    """Limits on the mean over the turn: cards, table and yield are those of the mean."""
    study = frames.study
    limits = study.limits.model_copy(update={"over": "mean"})
    text = written(replace(frames, study=study.model_copy(update={"limits": limits})))
    table = frames.distributions[frames.distributions["over"] == "mean"].set_index(["metric", "statistic"])["value"]
    row = cells(text, "Lost motion")
    assert row[2].startswith(METRICS["lost_motion_arcmin"].text(table["lost_motion_arcmin", "mean"]))
    assert row[1].startswith(percent(table["lost_motion_arcmin", "yield"]))
    assert f"Mean value over the turn of the {study.cycle.turn}" in text
    assert "It counts the mean value of each unit over 2 loaded crank angles" in text


def test_without_a_known_yield_the_page_says_so(frames):
    unknown = frames.distributions[frames.distributions["metric"] != "all_limits"]
    text = written(replace(frames, distributions=unknown))
    assert "of the units fail" not in text
    assert "a metric that has a limit is valid for none of them" in text


@pytest.mark.long
def test_how_a_worst_would_move_is_said_where_the_angles_tell(frames):
    assert "With twice as many" not in written(frames)  # two angles tell nothing
    rows = [("all_limits", np.nan, 0.75, 0.61), ("lost_motion_arcmin", 2.5, np.nan, np.nan)]
    table = pd.DataFrame(
        [
            {"metric": name, "n_angles": 31, "worst_mean": mean, "yield": share, "extrapolated": False}
            for name, mean, share, _ in rows
        ]
        + [
            {"metric": name, "n_angles": 62, "worst_mean": mean + 0.012, "yield": share, "extrapolated": True}
            | {"worst_mean_settled": mean + 0.003, "yield_settled": share + 0.1}
            for name, mean, _, share in rows
        ]
    )
    text = written(replace(frames, convergence=table))
    assert "(with twice as many an estimated 61.0 to 71.0 %)" in text
    assert "the lost motion by 0.012 to 0.003 arcmin" in text
    assert "With twice as many" not in written(replace(frames, convergence=table[~table["extrapolated"]]))


def test_markup_in_a_title_is_text(frames):
    text = written(replace(frames, study=frames.study.model_copy(update={"title": "<script>alert(1)</script>"})))
    assert "<script>alert" not in text
    assert "&lt;script&gt;alert" in text


@pytest.mark.long
def test_listed_cases_are_told_case_by_case_and_not_as_a_distribution(page_runs, page_outputs):
    cases = [{"label": "tight"}, {"label": "loose", "disk_profile": 10, "roller_diameter": -5}]
    study = tiny_study(
        "cases",
        samples={"experiment": "cases", "nominal_first": False},
        cases=cases,
        tolerances=None,
        cycle={"crank_deg": [0.0, 90.0], "levels_per_branch": 4, "keep_contacts": "all"},
    )
    run(STAGES, study, ["aggregate", "tails", "forms"], page_runs, Resources(1, 7))
    frames = frames_of(study, page_runs)
    text = written(frames)
    worst = frames.metrics.groupby("sample")["lost_motion_arcmin"].max()
    for sample, label in enumerate(("tight", "loose")):
        assert cells(text, label)[1] == METRICS["lost_motion_arcmin"].text(worst[sample])
    limits = study.limits.model_dump()
    for row in case_rows(frames):
        sample = ("tight", "loose").index(row.label)
        for name, fails in zip(frames.shown_metrics, row.failing, strict=True):
            value = frames.metrics.loc[frames.metrics["sample"] == sample, name]
            is_beyond = value.min() < limits[name] if METRICS[name].smaller_is_worse else value.max() > limits[name]
            assert fails == is_beyond
    assert 'class="n fails"' in text
    assert "Which tolerance decides" not in text
    names = {drawing.name: drawing for drawing in drawings(frames)}
    assert "distributions" not in names
    labels = [artist.get_label() for artist in names["hysteresis"].figure().axes[0].lines]
    assert labels[:2] == ["tight", "loose"]
    assert "output rollers at 0.36 N m" in names["output_loads"].title
