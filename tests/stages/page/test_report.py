"""The report stage on real runs of a tiny study: one self-contained page whose numbers are those of the tables."""

import base64
import re
import tomllib
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.config import Study, load_design, parse_study
from pipeline.config.studies.study import Limits
from pipeline.engine.cache import Cache
from pipeline.engine.runner import Resources, run
from pipeline.engine.stage import Job, Sections
from pipeline.engine.store import Output
from pipeline.figures.labels import METRICS
from pipeline.report.cases import case_rows
from pipeline.report.chain.graph import BOX, GAP, StageNote, stage_graph
from pipeline.report.drawings import drawings
from pipeline.report.frames import HEADLINES, Frames
from pipeline.report.layout.wording import interval, percent_interval, plain
from pipeline.report.page import report_page
from pipeline.report.turn.section import TurnSection
from pipeline.report.validity import overloaded, ranges
from stages import report
from stages.chain import STAGES

ROOT = Path(__file__).parents[3]
FAILURE = "no equilibrium at <3> N m: residual 1e-3"


def tiny_study(name: str, **changes: object) -> Study:
    """The quick study with a dozen samples and the coarsest mesh."""
    data = tomllib.loads((ROOT / "data/studies/quick.toml").read_text(encoding="utf-8"))
    data["samples"] |= {"count": 12}
    data["cycle"] |= {"crank_deg": [0.0, 90.0], "levels_per_branch": 4}
    data["reduce"] |= {
        "flank_edges_per_lobe": 12,
        "patch_half_width_mm": 0.3,
        "growth": 1.0,
        "largest_edge_mm": 3.0,
    }
    data["springs"]["table_points"] = 16
    data |= changes
    data = {name: section for name, section in data.items() if section is not None}
    return parse_study(data, name, f"{name}.toml", lambda design: load_design(design, ROOT))


@pytest.fixture(scope="module")
def runs(new_runs) -> Path:
    return new_runs()


@pytest.fixture(scope="module")
def outputs(runs) -> dict[str, Output]:
    return run(STAGES, tiny_study("tiny"), ["report"], runs, Resources(1, 7))


@pytest.fixture(scope="module")
def page(outputs) -> str:
    return (outputs["report"].folder / "report.html").read_text(encoding="utf-8").replace("\u00a0", " ")


@pytest.fixture(scope="module")
def frames(runs, outputs) -> Frames:
    return frames_of(tiny_study("tiny"), runs)


def frames_of(study: Study, runs: Path) -> Frames:
    """The frames of a run as anyone reads them with pandas."""

    def table(name: str) -> pd.DataFrame:
        return pd.read_parquet(runs / study.name / f"{name}.parquet")

    metrics = table("aggregate/metrics")
    return Frames(
        study=study,
        metrics=metrics,
        units=table("aggregate/units"),
        distributions=table("aggregate/distributions"),
        convergence=table("aggregate/convergence"),
        sample_convergence=table("aggregate/sample_convergence"),
        tails=table("tails/tails"),
        sensitivity=table("aggregate/sensitivity"),
        status=table("hysteresis/status"),
        contacts=table("clearance/contacts"),
        gaps=table("clearance/gaps"),
        curves=table("hysteresis/curves"),
        loads=table("hysteresis/contacts"),
        transmission=table("aggregate/transmission"),
        orders=table("aggregate/orders"),
        turn_contacts=table("hysteresis/turn_contacts"),
        laws=table("springs/laws"),
        mesh=(1234, 5678),
    )


def test_the_section_of_the_turn_says_what_the_study_lacks(frames) -> None:
    """Two loaded angles tell no error under load; the play at 181 of rigid bodies does; no speed, no life."""
    section = TurnSection(frames)
    titles = {row.title: row for row in section.rows}
    nominal = frames.units.set_index("sample").loc[0, "unloaded_transmission_error_arcsec"]
    assert titles["Transmission error without load"].values == (f"{nominal:.2f}",)
    assert "Transmission error under load" not in titles
    unknown = " ".join(section.unknown)
    assert "Transmission error under load: it needs 8 crank angles evenly over the turn or more." in unknown
    assert "input_speed_rpm" in unknown
    assert "operation.rating" in unknown
    page = written(frames)
    assert 'id="turn"' in page
    assert titles["Transmission error without load"].estimates[0].value in page


STAGES_RUN = [
    StageNote("sample", (), "2026-01-02T03:04:05+00:00", 1.0, 10, 0, 80),
    StageNote("clearance", ("sample",), "2026-01-02T03:05:05+00:00", 2.0, 10, 3, 80),
    StageNote("hysteresis", ("sample", "clearance"), "2026-01-02T03:06:05+00:00", 5.0, 0, 0, 0),
]


def test_stages_stand_right_of_what_they_read():
    graph = stage_graph(STAGES_RUN)
    assert [stage.x for stage in graph.boxes] == [0, BOX[0] + GAP[0], 2 * (BOX[0] + GAP[0])]
    assert len(graph.lines) == 2  # what hysteresis reads of sample goes by clearance too
    assert [stage.share for stage in graph.boxes] == pytest.approx([1 / 8, 2 / 8, 5 / 8])
    assert "clearance reads sample: 2.0 s, 3 items failed" in graph.description
    assert [stage.note.state for stage in graph.boxes] == ["10 done", "3 of 10 failed", "nothing asked for"]


def written(frames: Frames) -> str:
    """The page without pictures."""
    return report_page(frames, {}, [], STAGES_RUN, {"numpy": "2"}).replace("\u00a0", " ")


class PageResources(HTMLParser):
    """Every address and element that a browser would fetch or run."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.elements: set[str] = set()
        self.anchors: set[str] = set()
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.elements.add(tag)
        attributes = dict(attrs)
        self.addresses += [
            attributes[name] for name in ("src", "xlink:href", "href", "srcset", "action", "data") if name in attributes
        ]
        if "id" in attributes:
            self.anchors.add(attributes["id"])


def test_page_needs_nothing_beside_it(page):
    resources = PageResources(page)
    outside_path = [
        address for address in resources.addresses if not address.startswith(("data:image/svg+xml;base64,", "#"))
    ]
    assert outside_path == []
    assert {address[1:] for address in resources.addresses if address.startswith("#")} <= resources.anchors
    assert not resources.elements & {"link", "iframe", "object", "video"}
    assert not re.search(r"https?://|@import|url\(", page)


def test_every_figure_is_written_twice_and_stands_in_the_page(outputs, page):
    folder = outputs["report"].folder / "figures"
    names = {path.stem for path in folder.glob("*.svg")}
    assert names == {path.stem for path in folder.glob("*.png")}
    assert names >= {
        "reducer", "mesh", "spring_laws", "clearances", "dead_zones", "pin_loads", "output_loads", "bearing",
        "hysteresis", "distributions", "cranks", "drivers_lost_motion_arcmin",
    }  # fmt: skip
    shown_part = re.findall(r'<img src="data:image/svg\+xml;base64,([^"]+)"', page)
    assert sorted(base64.b64decode(source) for source in shown_part) == sorted(
        p.read_bytes() for p in folder.glob("*.svg")
    )
    numbers = [int(number) for number in re.findall(r"<b>Figure (\d+)\.", page)]
    assert numbers == list(range(1, len(names) + 1))


def cells(page: str, heading: str) -> list[str]:
    """Text of the cells of the first row with this heading; a number and its interval are parted by a bar."""
    title = rf"(?:{heading}|<a [^>]*>{heading}</a>)(?: <span[^>]*>[^<]*</span>)?"
    row = re.search(rf'<tr><th scope="row">{title}</th>(.*?)</tr>', page.partition('id="results"')[2], re.DOTALL)
    assert row, heading
    matches = re.findall(r"<td[^>]*>(.*?)</td>", row[1], re.DOTALL)
    return [re.sub(r"<[^>]*>", "", cell.replace('<span class="ci">', "|")) for cell in matches]


def test_key_numbers_are_those_of_the_tables(page, frames):
    worst = frames.distributions[frames.distributions["over"] == "worst"].set_index(["metric", "statistic"])
    for metric in HEADLINES:
        quantity = METRICS[metric]
        expected = [quantity.text(frames.units.loc[frames.units["sample"] == 0, f"{metric}_worst"].item())]
        for statistic in ("mean", "std", "p05", "p95"):
            row = worst.loc[(metric, statistic)]
            expected.append(f"{quantity.text(row['value'])}|{interval(row['ci_low'], row['ci_high'], quantity)}")
        limit, share = getattr(frames.study.limits, metric), worst.loc[(metric, "yield")]
        expected.append(f"{'≥' if quantity.smaller_is_worse else '≤'} {plain(limit)}")
        expected.append(f"{100 * share['value']:.1f} %|{percent_interval(share['ci_low'], share['ci_high'])}")
        assert cells(page, quantity.title) == expected
    combined = worst.loc[("all_limits", "yield"), "value"]
    assert cells(page, "All limits together")[-1].startswith(f"{100 * combined:.1f} %|")


def test_numbers_at_each_crank_angle_are_those_of_the_tables(page, frames):
    rows = frames.distributions[frames.distributions["crank_deg"] == 90.0].set_index(["metric", "statistic"])["value"]
    nominal = frames.metrics[(frames.metrics["sample"] == 0) & (frames.metrics["crank_deg"] == 90.0)].iloc[0]
    expected = []
    for metric in HEADLINES:
        quantity = METRICS[metric]
        expected += [quantity.text(nominal[metric]), quantity.text(rows[metric, "mean"])]
        expected.append(interval(rows[metric, "p05"], rows[metric, "p95"], quantity))
    assert re.search(
        r'<tr><th scope="row" class="n">90</th>\s*'
        + r"\s*".join(rf'<td class="n">{re.escape(text)}</td>' for text in expected),
        page,
    )


def test_band_is_over_the_samples_at_the_first_crank_angle(frames):
    values = frames.of_band(frames.curves, "angle_arcmin")
    assert frames.band.tolist() == list(range(1, 13))
    rows = frames.curves[(frames.curves["crank_deg"] == 0.0) & (frames.curves["sample"] > 0)]
    expected = rows.pivot(index="sample", columns="step", values="angle_arcmin")
    np.testing.assert_array_equal(values, expected.to_numpy())


def test_every_number_of_the_design_is_told_with_its_origin(page, frames):
    design = frames.study.design
    for section in (design.cycloid, design.disk, design.bearing, design.output):
        for value in section.model_dump().values():
            if isinstance(value, int | float):
                assert f'<td class="n">{plain(value)}</td>' in page
    for provenance in design.provenance.values():
        assert provenance.reason in page.replace("&#39;", "'")
    assert page.count('class="tag calibrated"') == sum(p.status == "calibrated" for p in design.provenance.values())


def test_paths_of_the_page_are_read_by_pandas(page, runs):
    message = re.findall(r'<tr><td><code>([^<]+)</code></td><td>[^<]*</td><td class="n">([\d,]+)</td>', page)
    assert len(message) == sum(len(stage.tables) for stage in STAGES)
    for path, rows in message:
        assert len(pd.read_parquet(runs / "tiny" / path)) == int(rows.replace(",", ""))


def test_few_samples_leave_indices_and_bounds_undetermined_and_say_why(page, frames):
    assert not np.isfinite(frames.distributions["ci_high"]).all()
    assert "Shares of the variance are not determined" in page
    assert "nan" not in re.sub(r'"data:[^"]*"', "", page).lower().replace("nanu", "")
    assert not re.search(r"\binf\b", re.sub(r'"data:[^"]*"', "", page))


def test_shares_of_the_variance_are_told_as_far_as_they_are_determined(frames):
    rows = [
        ("ovality_2", "first_order", 0.39, 0.35, 0.43),
        ("pin_radial", "first_order", 0.02, -0.05, 0.09),
        ("sum", "first_order", 0.41, 0.3, 0.5),
        ("pin_radial", "total", 0.3, 0.25, 0.35),
        ("ovality_2", "total", 0.47, 0.42, 0.52),
        ("pin_radius", "total", 0.02, 0.01, 0.04),
        ("sum", "total", 0.79, 0.7, 0.9),
    ]
    shares = pd.DataFrame(rows, columns=["parameter", "kind", "index", "ci_low", "ci_high"])
    shares = shares.assign(metric="torsional_rigidity_Nm_per_arcmin", over="worst", n=400)
    message = written(replace(frames, sensitivity=pd.concat([frames.sensitivity, shares])))
    oval, radial = "two-lobed ovality of pin circle", "radial pin position"
    assert f"of the torsional rigidity: {oval}, 47.0 % of the variance, 39.0 % by itself" in message
    assert f"<td>{oval} (47.0 %); {radial} (30.0 %)</td><td>{oval} (39.0 %)</td>" in message
    assert '59.0 %<span class="ci">50.0 to 70.0 %</span>' in message, (
        "what the shares by themselves leave to interactions"
    )
    assert "from 400 pairs of units" in message


def job(outputs: dict[str, Output], folder: Path) -> Job:
    """What the engine gives to the stage, writing into another folder."""
    sections = Sections(tiny_study("tiny"), (*report.REPORT.sections, "name"))
    inputs = {name: outputs[name] for name in report.REPORT.reads}
    return Job(sections, 1, folder, inputs, Cache(folder / "cache", ""))


def test_same_run_gives_the_same_bytes(outputs, tmp_path):
    assert report.REPORT.run(job(outputs, tmp_path)) == {}
    report_folder = outputs["report"].folder
    for name in outputs["report"].record["files"]:
        assert (tmp_path / name).read_bytes() == (report_folder / name).read_bytes(), name


def test_only_the_first_samples_are_read_for_bands(outputs, tmp_path, monkeypatch):
    captions = []
    original = report.drawings

    def noted(frames):
        assert frames.curves["sample"].max() == frames.gaps["sample"].max() == 5
        for drawing in original(frames):
            captions.append(drawing.caption)
            yield drawing

    monkeypatch.setattr(report, "BAND_SAMPLES", 5)
    monkeypatch.setattr(report, "drawings", noted)
    monkeypatch.setattr(report, "save", lambda figure, stem: stem.with_suffix(".svg").write_bytes(b""))
    report.REPORT.run(job(outputs, tmp_path))
    assert sum("The band is over the first 5 samples." in caption for caption in captions) == 3


def failing(frames: Frames, rows: list[int]) -> Frames:
    """The frames with load cycles that have no result."""
    lost_motion = np.isin(np.arange(len(frames.metrics)), rows)
    status = np.where(lost_motion, FAILURE, "ok")
    metrics = frames.metrics.assign(status=status)
    metrics.loc[lost_motion, list(METRICS)] = np.nan
    units = frames.units.assign(status=np.where(lost_motion.reshape(-1, 2).any(axis=1), FAILURE, "ok"))
    units.loc[units["status"] != "ok", [f"{name}_worst" for name in METRICS]] = np.nan
    return replace(frames, metrics=metrics, status=frames.status.assign(status=status), units=units)


def test_failed_samples_are_listed_with_their_reasons_and_left_out_of_bands(frames):
    candidate = failing(frames, [0, 7])
    text = written(candidate)
    assert "2 of 26 load cycles have no result; they belong to 2 samples" in text
    assert "no equilibrium at &lt;3&gt; N m: residual 1e-3" in text
    assert "nominal reducer" in text
    assert 3 not in candidate.band
    assert len(candidate.band) == 11
    assert candidate.drawn == {}
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
        "hysteresis",
        "bearing",
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
    (sentence,) = overloaded(tight)
    assert sentence.startswith(f"{len(pins)} pins ({ranges(pins)}) and ")
    assert sentence.endswith("of the nominal reducer")
    loose = replace(frames, study=frames.study.model_copy(update={"limits": Limits(peak_pressure_MPa=1e6)}))
    assert overloaded(loose) == ["none of the nominal reducer"]
    assert ranges([3, 70, 71, 72, 75, 76]) == "3, 70–72, 75–76"


def test_the_page_shows_what_the_limits_are_of(frames):
    """Limits on the mean over the turn: cards, table and yield are those of the mean."""
    study = frames.study
    limits = study.limits.model_copy(update={"over": "mean"})
    text = written(replace(frames, study=study.model_copy(update={"limits": limits})))
    table = frames.distributions[frames.distributions["over"] == "mean"].set_index(["metric", "statistic"])["value"]
    row = cells(text, "Lost motion")
    assert row[1].startswith(METRICS["lost_motion_arcmin"].text(table["lost_motion_arcmin", "mean"]))
    assert row[-1].startswith(f"{100 * table['lost_motion_arcmin', 'yield']:.1f} %")
    assert "Mean value over the turn of the crank" in text
    assert "by their mean value" in text


def test_without_a_known_yield_the_page_says_so(frames):
    unknown = frames.distributions[frames.distributions["metric"] != "all_limits"]
    text = written(replace(frames, distributions=unknown))
    assert "All limits together are kept" not in text
    assert "a number that has a limit holds for none of them" in text


def test_how_a_worst_would_move_is_said_where_the_angles_tell(frames):
    assert "with twice as many" not in written(frames)  # two angles tell nothing
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
    assert "with twice as many it would be 61.0 to 71.0 %" in text
    assert "the lost motion by 0.012 to 0.003 arcmin" in text
    assert "with twice as many" not in written(replace(frames, convergence=table[~table["extrapolated"]]))


def test_markup_in_a_title_is_text(frames):
    text = written(replace(frames, study=frames.study.model_copy(update={"title": "<script>alert(1)</script>"})))
    assert "<script>alert" not in text
    assert "&lt;script&gt;alert" in text


def test_listed_cases_are_told_case_by_case_and_not_as_a_distribution(runs, outputs):
    cases = [{"label": "tight"}, {"label": "loose", "disk_profile": 10, "roller_diameter": -5}]
    study = tiny_study(
        "cases",
        samples={"experiment": "cases", "nominal_first": False},
        cases=cases,
        tolerances=None,
        cycle={"crank_deg": [0.0, 90.0], "levels_per_branch": 4, "keep_contacts": "all"},
    )
    run(STAGES, study, ["aggregate", "tails"], runs, Resources(1, 7))
    frames = frames_of(study, runs)
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
    labels = [artist.get_label() for artist in names["hysteresis"].figure.axes[0].lines]
    assert labels[:2] == ["tight", "loose"]
    assert "output rollers at 0.36 N m" in names["output_loads"].title
