"""The report in a browser: no script error, no request, nothing wider than the page, contrast, a reader's actions."""

import json
from collections.abc import Iterator
from importlib import resources
from pathlib import Path

import chromium
import pandas as pd
import pytest

from pipeline.engine.store import Output

pytestmark = pytest.mark.skipif(chromium.PROGRAM is None, reason="no Chromium (on Debian: apt-get install chromium)")

WIDTHS = (1280, 390)


@pytest.fixture(scope="module")
def report(page_outputs: dict[str, Output]) -> Path:
    return page_outputs["report"].folder / "report.html"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[chromium.Page]:
    with chromium.browser(tmp_path_factory.mktemp("profile")) as opening:
        yield opening


@pytest.fixture(scope="module")
def units(page_outputs: dict[str, Output]) -> pd.DataFrame:
    return pd.DataFrame(page_outputs["aggregate"].read("units")).set_index("sample").drop(index=0)


def of_explorer(page: chromium.Page, selector: str, expression: str) -> object:
    return page.value(f"[...document.querySelectorAll('#explorer {selector}')].map((element) => {expression})")


@pytest.mark.parametrize("width", WIDTHS)
def test_page_asks_for_nothing_and_runs_without_error(page, report, width):
    page.open(report, width)
    assert page.errors == []
    assert page.requests == []


@pytest.mark.parametrize("width", WIDTHS)
def test_nothing_is_wider_than_the_page(page, report, width):
    page.open(report, width)
    assert page.value("document.documentElement.scrollWidth") <= width


FONTS = ("Liberation Sans", "DejaVu Sans", "monospace")
"""Of systems with Arial's widths, with wider letters, and with the widest."""


@pytest.mark.parametrize("width", [360, 800, 1024, 1300, 1400])
def test_no_number_of_the_results_is_cut(page, report, width):
    page.open(report, width)
    for font in FONTS:
        page.value(f"document.body.style.fontFamily = '{font}'")
        cut = page.value(
            "[...document.querySelectorAll('table.stacks')].filter((table) => {"
            "  const box = table.parentElement.getBoundingClientRect();"
            "  return [...table.querySelectorAll('tbody th, tbody td')].some((cell) => {"
            "    const place = cell.getBoundingClientRect();"
            "    return place.width > 0 && (place.right > box.right + 1 || cell.scrollWidth > cell.clientWidth + 1);"
            "  });"
            "}).map((table) => table.caption.textContent)"
        )
        assert cut == [], font
    columns = page.value("[...document.querySelectorAll('#results .stacks thead th')].map((cell) => cell.textContent)")
    assert columns[:3] == ["Metric", "Limit", "Yield"]


@pytest.mark.parametrize(("width", "dark"), [(1280, True), (390, False)])
@pytest.mark.long
def test_accessible_by_the_rules_of_axe(page, report, width, dark):
    page.open(report, width, dark=dark)
    page.value(resources.files("axe_core_python").joinpath("axe.min.js").read_text(encoding="utf-8") + "; true")
    result = page.value(
        "axe.run(document, {resultTypes: ['violations']}).then((result) => JSON.stringify(result.violations))"
    )
    violations = [
        f"{rule['id']}: {node['html'][:100]} {node['failureSummary']}"
        for rule in json.loads(result)
        for node in rule["nodes"]
    ]
    assert violations == []


def test_a_page_that_asks_for_something_is_found(page, report, tmp_path):
    damaged = tmp_path / "report.html"
    text = report.read_text(encoding="utf-8")
    damaged.write_text(text.replace("</main>", '<img src="neighbour.png" alt=""></main>'), encoding="utf-8")
    page.open(damaged, 390)
    assert page.errors or page.requests
    damaged.write_text(text.replace("</main>", "<pre style='width: 500px'>x</pre></main>"), encoding="utf-8")
    page.open(damaged, 390)
    assert page.value("document.documentElement.scrollWidth") > 390


def test_a_unit_that_is_pointed_at_shows_its_loop_and_forces(page, report, units):
    page.open(report, 1280)
    assert len(of_explorer(page, "circle", "1")) == len(units)
    page.value("document.getElementById('explorer').scrollIntoView({behavior: 'instant'})")
    path_before = of_explorer(page, ".curve", "element.getAttribute('d')")
    x, y = page.value(
        "(() => { const box = document.querySelectorAll('#explorer circle:not(.chosen)')[3].getBoundingClientRect();"
        "return [box.x + box.width / 2, box.y + box.height / 2]; })()"
    )
    page.move(x, y)
    line = page.value("document.querySelector('#explorer .line').textContent")
    sample = int(line.removeprefix("sample ").partition(":")[0])
    assert f"clearance backlash {units.at[sample, 'clearance_backlash_arcmin_worst']:.3f} arcmin" in line
    assert of_explorer(page, ".curve", "element.getAttribute('d')") != path_before
    assert len(of_explorer(page, ".bar", "1")) > 3


def test_forces_and_angles_of_the_page_are_those_of_the_tables(page, report, page_outputs):
    page.open(report, 1280)
    data = json.loads(page.value("document.getElementById('explorer-data').textContent"))
    contacts, curves = (pd.DataFrame(page_outputs["hysteresis"].read(table)) for table in ("contacts", "curves"))
    unit = data["units"][2]
    sample = int(unit["label"].removeprefix("sample "))
    loaded_contacts = contacts[(contacts["sample"] == sample) & (contacts["crank_deg"] == data["crank"])]
    loaded_contacts = loaded_contacts[
        loaded_contacts["step"] == loaded_contacts.loc[loaded_contacts["torque_Nm"].idxmax(), "step"]
    ].head(len(unit["force"]))
    loop = curves[(curves["sample"] == sample) & (curves["crank_deg"] == data["crank"])]
    assert unit["force"] == pytest.approx(loaded_contacts["force_N"].tolist(), abs=0.05)
    assert unit["angle"] == pytest.approx(loop["angle_arcmin"].tolist(), abs=5e-5)


def test_units_are_reached_by_keyboard(page, report):
    page.open(report, 1280)
    page.value("document.querySelector('#explorer svg[tabindex]').focus()")
    lines = []
    for _ in range(3):
        page.key("ArrowRight")
        lines.append(page.value("document.querySelector('#explorer .line').textContent"))
    assert len(set(lines)) == 3


def test_a_metric_is_picked_and_its_drivers_are_shown(page, report):
    page.open(report, 1280)
    panels = "[...document.querySelectorAll('[data-panel]')]"
    shown_part = f"{panels}.filter((panel) => panel.offsetParent).map((panel) => panel.dataset.panel)"
    assert page.value(shown_part) == ["Clearance backlash"]
    page.value(
        "[...document.querySelectorAll('.choice button')]"
        ".find((tab) => tab.textContent === 'Torsional rigidity').click()"
    )
    assert page.value(shown_part) == ["Torsional rigidity"]


def test_a_table_copies_into_a_spreadsheet(page, report):
    page.open(report, 1280)
    text = page.value(
        "[...document.querySelectorAll('button.copy')]"
        ".find((copy) => copy.nextElementSibling.textContent.includes('Standard deviation')).tableText()"
    )
    rows = [row.split("\t") for row in text.splitlines()]
    assert len({len(row) for row in rows}) == 1
    mean = rows[0].index("Mean")
    assert float(rows[2][mean]) > 0
    assert " to " in rows[2][mean + 1]


def test_dark_and_light_are_a_choice(page, report):
    ground = "getComputedStyle(document.body).backgroundColor"
    page.open(report, 1280, dark=True)
    dark = page.value(ground)
    page.value("document.getElementById('theme').click()")
    light = page.value(ground)
    page.open(report, 1280)
    assert page.value(ground) == light != dark


def test_contents_stay_in_sight(page, report):
    page.open(report, 1280)
    page.value("document.getElementById('data').scrollIntoView({behavior: 'instant'})")
    top = page.value("document.querySelector('nav').getBoundingClientRect().top")
    assert 0 <= top < 200
    page.value("new Promise((done) => setTimeout(done, 300))")
    assert page.value("document.querySelectorAll('nav a[aria-current]').length") == 1


def test_every_link_within_the_page_leads_somewhere(page, report):
    page.open(report, 1280)
    lost_motion = page.value(
        "[...document.querySelectorAll('a[href^=\"#\"]')].map((link) => link.getAttribute('href').slice(1))"
        ".filter((id) => !document.getElementById(id))"
    )
    assert lost_motion == []


def test_paper_shows_all_and_no_control(page, report):
    page.open(report, 1280, dark=True)
    page.call("Emulation.setEmulatedMedia", media="print")
    shown_part = (
        "(selector) => [...document.querySelectorAll(selector)].filter((element) => element.offsetParent).length"
    )
    panels = page.value("document.querySelectorAll('[data-panel]').length")
    assert page.value(f"({shown_part})('[data-panel]')") == panels > 1
    assert page.value(f"({shown_part})('nav, button')") == 0
    assert page.value("getComputedStyle(document.body).color") == "rgb(31, 41, 51)"


def test_the_summary_prints_on_a_page_of_its_own(page, report):
    """A4 with the margins of the page: 178 mm by 261 mm."""
    page.open(report, 673)
    page.call("Emulation.setEmulatedMedia", media="print")
    assert page.value("getComputedStyle(document.getElementById('summary')).breakAfter") == "page"
    bottom = page.value("document.getElementById('summary').getBoundingClientRect().bottom + scrollY")
    assert bottom < 261 / 25.4 * 96
    assert page.value("document.querySelector('main section').id") == "summary"
