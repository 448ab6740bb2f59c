"""A tiny study for the tests of its page, and its tables as anyone reads them."""

import re
import tomllib
from pathlib import Path

import pandas as pd

from pipeline.config import Study, load_design, parse_study
from pipeline.report.frames import Frames
from pipeline.report.sections.further import FORM_TABLES
from pipeline.report.sections.section import Page, StageNote, report_page

ROOT = Path(__file__).parents[3]


def tiny_study(name: str, **changes: object) -> Study:
    """The quick study with a dozen samples and the coarsest mesh."""
    data = tomllib.loads((ROOT / "data/studies/quick.toml").read_text(encoding="utf-8"))
    data["samples"] |= {"count": 12}
    data["cycle"] |= {"crank_deg": [0.0, 90.0], "levels_per_branch": 4, "keep_contacts": "all"}
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
        n_loops=len(table("hysteresis/status")),
        contacts=table("clearance/contacts"),
        gaps=table("clearance/gaps"),
        curves=table("hysteresis/curves"),
        loads=table("hysteresis/contacts"),
        transmission=table("aggregate/transmission"),
        orders=table("aggregate/orders"),
        turn_contacts=table("hysteresis/turn_contacts"),
        laws=table("springs/laws"),
        mesh=(1234, 5678),
        tables={name: table(name) for name in FORM_TABLES},
    )


STAGES_RUN = [
    StageNote("sample", (), "2026-01-02T03:04:05+00:00", 1.0, 10, 0, 80),
    StageNote("clearance", ("sample",), "2026-01-02T03:05:05+00:00", 2.0, 10, 3, 80),
    StageNote("hysteresis", ("sample", "clearance"), "2026-01-02T03:06:05+00:00", 5.0, 0, 0, 0),
]


def written(frames: Frames) -> str:
    """The page without pictures."""
    return report_page(Page(frames, {}, [], STAGES_RUN, {"numpy": "2"})).replace("\u00a0", " ")


def cells(page: str, heading: str) -> list[str]:
    """Text of the cells of the first row with this heading; a number and its interval are parted by a bar."""
    title = rf"(?:{heading}|<a [^>]*>{heading}</a>)(?: <span[^>]*>[^<]*</span>)?"
    row = re.search(rf'<tr><th scope="row">{title}</th>(.*?)</tr>', page.partition('id="results"')[2], re.DOTALL)
    assert row, heading
    matches = re.findall(r"<td[^>]*>(.*?)</td>", row[1], re.DOTALL)
    return [re.sub(r"<[^>]*>", "", cell.replace('<span class="ci">', "|")) for cell in matches]
