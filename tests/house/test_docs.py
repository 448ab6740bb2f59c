"""The pages for people name files, links, commands and names of the code that exist."""

import re
import shlex
import subprocess
import tomllib
from pathlib import Path

import pytest
import yaml

from pipeline.cli.parser import parser
from stages.chain import STAGES

ROOT = Path(__file__).parent.parent.parent
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs/validation").glob("*.md")),
]
MAKEFILE = (ROOT / "Makefile").read_text()
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
LEFT_BY_RUNS = ("data/runs/", "build/")
EXAMPLE = re.compile(r"[<*]|\bcorrected-|\bbest-")
"""What stands for a name that a user chooses."""


def spans(text: str) -> list[str]:
    """What stands between backticks, outside of blocks of code."""
    return re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL))


def commands(text: str) -> list[str]:
    """Lines of shell blocks, and commands between backticks."""
    lines = [line for block in re.findall(r"```sh\n(.*?)```", text, re.DOTALL) for line in block.splitlines()]
    return [*lines, *spans(text)]


def test_every_path_exists() -> None:
    names = [(page.name, span) for page in PAGES for span in spans(page.read_text())]
    names = [(page, path) for page, path in names if re.match(r"(pipeline|stages|tests|data|docs|\.ci)/", path)]
    names = [(page, path) for page, path in names if not path.startswith(LEFT_BY_RUNS) and not EXAMPLE.search(path)]
    assert len(names) > 60
    assert not [(page, path) for page, path in names if not (ROOT / path).exists()]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_leads_somewhere(page: Path) -> None:
    contracts = PROJECT["tool"]["importlinter"]["contracts"]
    rooms = [contract["id"] for contract in contracts if contract["type"] == "layers"]
    pictures = {f"generated/{name}.svg" for name in (*rooms, "chain")}
    links = [link for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text()) if "://" not in link]
    assert not [link for link in links if link not in pictures and not (page.parent / link.partition("#")[0]).exists()]


def test_every_page_is_in_the_table_of_contents() -> None:
    parts = re.findall(r"```\{toctree\}\n(.*?)```", (ROOT / "docs/index.md").read_text(), re.DOTALL)
    assert len(parts) == 4, "get started, how to, reference, explanation"
    names = {line for part in parts for line in part.splitlines() if line and not line.startswith(":")}
    docs = ROOT / "docs"
    pages = [*docs.iterdir(), *(docs / "validation").iterdir()]
    written = {str(page.relative_to(docs).with_suffix("")) for page in pages if page.suffix in {".md", ".rst"}}
    assert names == written - {"index"} | {"generated/gallery/index"}


def test_every_make_target_named_exists() -> None:
    targets = {*re.findall(r"^([a-z-]+):", MAKEFILE, re.MULTILINE), *(stage.name for stage in STAGES)}
    lines = [shlex.split(line, comments=True) for page in PAGES for line in commands(page.read_text())]
    names = {word for line in lines if line[:1] == ["make"] for word in line[1:] if "=" not in word}
    assert len(names) > 15
    assert names <= targets


def test_every_command_line_is_understood() -> None:
    lines = [line for page in PAGES for line in commands(page.read_text()) if re.match(r"\S*python -m pipeline ", line)]
    whole = [line for line in lines if not line.endswith("--study")]
    assert len(whole) >= 6
    for line in whole:
        parser().parse_args(shlex.split(line, comments=True)[3:])  # exits if it does not understand


def test_the_recipes_name_what_the_code_has() -> None:
    files = [
        path
        for folder in ("pipeline", "stages", "tests/validation", "tests/model/effects")
        for path in (ROOT / folder).rglob("*.py")
    ]
    code = "\n".join([MAKEFILE, *(path.read_text() for path in files)])
    words = set(re.findall(r"\w+", code))
    names = {span.removesuffix(".law") for span in spans((ROOT / "docs/recipes.md").read_text())}
    names = {name for name in names if re.fullmatch(r"[A-Za-z_]\w+", name)} - {"Makefile"}
    assert len(names) > 15
    assert names <= words


def test_every_stage_is_a_target_and_in_the_readme() -> None:
    command = ["make", "-s", "--eval", "targets:;@echo $(STAGES)", "targets"]
    targets = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    assert targets == [stage.name for stage in STAGES]
    assert re.findall(r"^\| `make (\w+)` \|", PAGES[0].read_text(), re.MULTILINE) == targets


def test_the_glossary_has_each_term_once() -> None:
    rows = re.findall(r"^\| ([^|]+) \|", (ROOT / "docs/glossary.md").read_text(), re.MULTILINE)
    terms = [term.strip() for row in rows if row not in {"term", "---"} for term in row.split(",")]
    assert len(terms) > 60
    assert len(terms) == len(set(terms)), sorted(term for term in set(terms) if terms.count(term) > 1)


def test_the_citation_is_of_this_version() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == PROJECT["project"]["version"]
    assert citation["license"] == PROJECT["project"]["license"]
    assert (ROOT / "CHANGELOG.md").read_text().count(f"\n## {citation['version']}\n") == 1
    versions = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(), flags=re.MULTILINE)[1:]
    assert all("\n### Numbers\n" in version for version in versions)  # what moved, by how much
