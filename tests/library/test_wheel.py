"""The installed package runs from any folder: built, installed without the checkout, and used."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROGRAM = """
import sys
from pathlib import Path
import pipeline
assert Path(pipeline.__file__).is_relative_to(sys.argv[1]), pipeline.__file__
study = pipeline.load_study("quick")
if sys.argv[2] == "report":
    assert pipeline.run(study, jobs=1).report.stat().st_size > 1e6
else:
    finished = pipeline.run(study.with_({"samples.count": 3}), ["sample"], jobs=1)
    assert len(finished.table("sample/reducer")) == 4
    assert finished.folder == Path.cwd() / "data/runs/quick"
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package as installed from its wheel, which is built from a copy of the files under version control."""
    home = tmp_path_factory.mktemp("wheel")
    files = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    wanted = [
        name for name in files.split("\0") if name.startswith(("pipeline/", "stages/", "data/")) or "/" not in name
    ]
    for name in filter(None, wanted):
        copy = home / "source" / name
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes((ROOT / name).read_bytes())
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "wheel", "--no-deps", "--no-build-isolation", "-w", home, home / "source"], check=True)
    (wheel,) = home.glob("*.whl")
    subprocess.run([*pip, "install", "--no-deps", "--no-index", "--target", home / "site", wheel], check=True)
    return home / "site"


@pytest.mark.parametrize("stage", ["sample", pytest.param("report", marks=pytest.mark.attack)])
@pytest.mark.long
def test_the_installed_package_runs_a_study_from_another_folder(site: Path, tmp_path: Path, stage: str) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "CYCLOID_ROOT"}
    process = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(site), stage],
        env=environment | {"PYTHONPATH": str(site)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert process.returncode == 0, process.stderr
