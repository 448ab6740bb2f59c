"""What is installed is what was pinned, under known licences, and a study asks nobody on the network."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from tests.validation.__main__ import main
from tests.validation.licences import PINNED, UNKNOWN, licences

ROOT = Path(__file__).parent.parent.parent
CONSTRAINTS = ROOT / "constraints.txt"
PINS = (CONSTRAINTS, ROOT / "docs/requirements.txt")
STUDY = """
import sys
from pathlib import Path
from pipeline import cli
from pipeline import settings
settings.RUNS = Path(sys.argv[1])
sys.exit(cli.main(["run", sys.argv[3], "--study", sys.argv[2], "--jobs", "2"]))
"""


def _same(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def test_every_package_is_pinned_with_the_hashes_of_its_files() -> None:
    text = "".join(path.read_text() for path in PINS)
    entries = re.split(r"^(?=[A-Za-z0-9])", text, flags=re.MULTILINE)[1:]
    assert len(entries) == len(PINNED.findall(text)) > 90
    for entry in entries:
        assert len(re.findall(r"--hash=sha256:[0-9a-f]{64}", entry)) >= 1, entry
    pinned = {_same(match["name"]) for match in PINNED.finditer(text)}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = [name for names in project["optional-dependencies"].values() for name in names]
    expected = {_same(re.split(r"[\[<>=; ]", name)[0]) for name in [*project["dependencies"], *extras]}
    assert expected - {_same(project["name"])} <= pinned
    for path in PINS:
        assert f"--require-hashes --no-deps --requirement {path.relative_to(ROOT)}" in (ROOT / "Makefile").read_text()


def test_the_pins_leave_no_requirement_open() -> None:
    """Pip looks for none: a newer release of what a package requires with an extra would be refused without a hash."""
    missing = []
    for package in metadata.distributions():
        for text in package.requires or []:
            requirement = Requirement(text)
            if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
                try:
                    version = metadata.version(requirement.name)
                except metadata.PackageNotFoundError:
                    version = ""
                if not version or not requirement.specifier.contains(version, prereleases=True):
                    missing.append(f"{package.name} requires {text}, found {version or 'none'}")
    assert not missing


def test_both_files_of_pins_agree() -> None:
    first_order, second = (
        {_same(match["name"]): match["version"] for match in PINNED.finditer(p.read_text())} for p in PINS
    )
    shared = first_order.keys() & second.keys()
    assert len(shared) > 5
    assert {name: first_order[name] for name in shared} == {name: second[name] for name in shared}


def test_every_installed_package_states_its_licence(capsys: pytest.CaptureFixture) -> None:
    licence_rows = licences(CONSTRAINTS)
    installed = [package_row for package_row in licence_rows if package_row.version != UNKNOWN]
    assert len(installed) > 50
    assert [package_row.package for package_row in installed if package_row.licence == UNKNOWN] == []
    assert not [
        package_row for package_row in installed if re.search(r"\bA?GPL", package_row.licence)
    ]  # this program is MIT
    assert main(["licences"]) == 0
    assert re.search(r"^numpy +\d+\.\S+ +BSD", capsys.readouterr().out, re.MULTILINE)


@pytest.mark.parametrize("stage", ["clearance", pytest.param("report", marks=pytest.mark.attack)])
@pytest.mark.long
def test_a_study_runs_without_any_network(tmp_path: Path, stage: str) -> None:
    """In a network namespace of its own, without so much as a loopback; the report then loads nothing either."""
    if not shutil.which("unshare") or subprocess.run(["unshare", "-rn", "true"]).returncode:
        pytest.skip("a network namespace of one's own is not permitted here")
    text = (ROOT / "data/studies/quick.toml").read_text().replace("count = 50", "count = 4")
    (tmp_path / "small.toml").write_text(text.replace("crank_deg = [0.0, 90.0]", "crank_deg = [0.0]\nrigid_angles = 3"))
    command = [
        "unshare",
        "-rn",
        sys.executable,
        "-c",
        STUDY,
        str(tmp_path / "runs"),
        str(tmp_path / "small.toml"),
        stage,
    ]
    process = subprocess.run(
        command, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False
    )
    assert process.returncode == 0, process.stderr
    if stage == "report":
        assert not re.search(
            r"""(src|href)=["'](https?:)?//""", (tmp_path / "runs/small/report/report.html").read_text()
        )
