"""The report stage on real runs of a tiny study: one self-contained page whose numbers are those of the tables."""

import base64
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from small_study import save_named
from tiny_pages import cells, tiny_study, written

from pipeline.engine.cache import Cache
from pipeline.engine.stage import Job, Sections
from pipeline.engine.store import Output
from pipeline.figures import style
from pipeline.figures.labels import METRICS
from pipeline.report.frames import HEADLINES
from pipeline.report.layout import interval, percent, percent_interval, plain_number
from pipeline.report.results import Results
from pipeline.report.sections.turn import TurnSection
from stages import report
from stages.chain import REPORT, STAGES


def test_the_section_of_the_turn_says_what_the_study_lacks(frames) -> None:
    """Two loaded angles tell no error under load; the play at 181 of rigid bodies does; no speed, no life."""
    section = TurnSection(frames, Results(frames))
    titles = {row.title: row for row in section.rows}
    nominal = frames.units.set_index("sample").loc[0, "unloaded_transmission_error_arcsec"]
    assert titles["Transmission error without load"].values == (f"{nominal:.2f}",)
    assert "Transmission error under load" not in titles
    unknown = " ".join(section.unknown_metrics)
    assert "Transmission error under load: it needs 8 crank angles evenly over the turn or more." in unknown
    assert "input_speed_rpm" in unknown
    assert "operation.rating" in unknown
    page = written(frames)
    assert 'id="turn"' in page
    assert titles["Transmission error without load"].estimates[0].value in page


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


def test_every_figure_is_written_twice_and_stands_in_the_page(page_outputs, page):
    folder = page_outputs["report"].folder / "figures"
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
    numbers = re.findall(r"<b>Figure (\d+)([a-z]?)\.", page)
    assert len(numbers) == len(names)
    assert list(dict.fromkeys(int(number) for number, _ in numbers)) == list(range(1, int(numbers[-1][0]) + 1))
    panels = [letter for _, letter in numbers if letter]
    assert panels == list("abcdefgh"[: len(panels)]), "panels of which one is shown share a number"


def test_key_numbers_are_those_of_the_tables(page, frames):
    worst = frames.distributions[frames.distributions["over"] == "worst"].set_index(["metric", "statistic"])
    for metric in HEADLINES:
        quantity = METRICS[metric]
        limit, share = getattr(frames.study.limits, metric), worst.loc[(metric, "yield")]
        expected = [f"{'≥' if quantity.smaller_is_worse else '≤'} {plain_number(limit)}"]
        expected.append(f"{percent(share['value'])}|{percent_interval(share['ci_low'], share['ci_high'])}")
        for statistic in ("mean", "p05", "p95", "std"):
            row = worst.loc[(metric, statistic)]
            expected.append(f"{quantity.text(row['value'])}|{interval(row['ci_low'], row['ci_high'], quantity)}")
        expected.append(quantity.text(frames.units.loc[frames.units["sample"] == 0, f"{metric}_worst"].item()))
        assert cells(page, quantity.title) == expected
    combined = worst.loc[("all_limits", "yield"), "value"]
    assert cells(page, "All limits together")[1].startswith(f"{percent(combined)}|")


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
                assert f'<td class="n">{plain_number(value)}</td>' in page
    for provenance in design.provenance.values():
        assert provenance.reason in page.replace("&#39;", "'")
    assert page.count('class="tag calibrated"') == sum(p.status == "calibrated" for p in design.provenance.values())


def test_paths_of_the_page_are_read_by_pandas(page, page_runs):
    message = re.findall(r'<tr><td><code>([^<]+)</code></td><td>[^<]*</td><td class="n">([\d,]+)</td>', page)
    assert len(message) == sum(len(stage.tables) for stage in STAGES)
    for path, rows in message:
        assert len(pd.read_parquet(page_runs / "tiny" / path)) == int(rows.replace(",", ""))


def test_few_crank_angles_do_not_tell_what_more_would_leave_and_the_page_says_so(page, frames):
    assert frames.units["n_angles"].iloc[0] == 2
    assert "It counts 2 loaded crank angles; over the whole turn of the output the yield is at most this." in page
    assert "with twice as many an estimated" not in page


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
    without_friction = shares.assign(metric="efficiency_percent", over="turn", index=np.nan, n=0)
    message = written(replace(frames, sensitivity=pd.concat([frames.sensitivity, shares, without_friction])))
    oval, radial = "two-lobed ovality of pin circle", "radial pin position"
    assert f"main contributor: <b>{oval} (47.0 % of its variance, interactions included)</b>" in message
    assert f"<td>{oval} (47.0 %); {radial} (30.0 %)</td><td>{oval} (39.0 %)</td>" in message
    assert '59.0 %<span class="ci">50.0 to 70.0 %</span>' in message, (
        "what the shares by themselves leave to interactions"
    )
    assert "jackknife" not in message, "the intervals of the shares are by bootstrap"
    assert "from 400 pairs of units" in message, "of the metrics that have shares"
    assert "Shares of the variance are not determined by" not in message.replace("</b>", "")


def job(page_outputs: dict[str, Output], folder: Path) -> Job:
    """What the engine gives to the stage, writing into another folder."""
    sections = Sections(tiny_study("tiny"), (*REPORT.sections, "name"))
    inputs = {name: page_outputs[name] for name in REPORT.reads}
    return Job(sections, 1, folder, inputs, Cache(folder / "cache", ""))


def test_same_run_gives_the_same_bytes(page_outputs, tmp_path, monkeypatch):
    """The page but for its pictures, and a picture of lines and one of bands; all pictures are written one way."""
    pictures = ("hysteresis", "mesh")
    monkeypatch.setattr(style, "save", save_named(*pictures))
    assert REPORT.run(job(page_outputs, tmp_path)) == {}
    folders = tmp_path, page_outputs["report"].folder
    for name in (f"figures/{picture}{ending}" for picture in pictures for ending in (".svg", ".png")):
        assert len({(folder / name).read_bytes() for folder in folders}) == 1, name
    pages = {re.sub('src="data:image[^"]*"', "", (folder / "report.html").read_text()) for folder in folders}
    assert len(pages) == 1


@pytest.mark.long
def test_only_the_first_samples_are_read_for_bands(page_outputs, tmp_path, monkeypatch):
    captions = []
    original = report.drawings

    def noted(frames):
        assert frames.curves["sample"].max() == frames.gaps["sample"].max() == 5
        for drawing in original(frames):
            captions.append(drawing.caption)
            yield drawing

    monkeypatch.setattr(report, "BAND_SAMPLES", 5)
    monkeypatch.setattr(report, "drawings", noted)
    monkeypatch.setattr(style, "save", lambda figure, stem: stem.with_suffix(".svg").write_bytes(b""))
    REPORT.run(job(page_outputs, tmp_path))
    assert sum("The band is over the first 5 samples." in caption for caption in captions) == 3


@pytest.mark.long
def test_the_page_says_whether_nominal_lies_outside_of_its_own_zone(frames):
    inside = "The nominal reducer lies within all of its tolerance zones."
    assert inside in written(frames)
    one_sided = {"distribution": "uniform", "lower_um": 1.0, "upper_um": 4.0, "allowance_um": 10.0}
    study = tiny_study("tiny", tolerances={"disk_profile": one_sided})
    page = written(replace(frames, study=study)).replace("\u00a0", " ")
    assert "lies outside of its own tolerance zone" in page
    assert "(zone 11 to 14 µm, middle 12.5, nominal 10)" in page
    assert inside not in page
