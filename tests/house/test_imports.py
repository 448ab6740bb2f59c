"""The direction of imports, by the contracts of pyproject.toml, and what the mechanics and the engine may know."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import grimp
import pytest
from importlinter.cli import EXIT_STATUS_SUCCESS, lint_imports

ROOT = Path(__file__).parent.parent.parent
LIBRARIES_OF_THE_MODEL = {"filelock", "numba", "numpy", "scipy", "skfem"}  # the first for the compiler's cache
ERRORS = "pipeline.errors"  # so that a user never sees a traceback for what the model refuses; imports nothing of ours
REGISTRY = "pipeline.registry"  # what is declared one file each, found; imports nothing of ours either
FILES_AND_SETTINGS = {"argparse", "csv", "io", "json", "logging", "os", "pathlib", "shutil", "tempfile", "tomllib"}
MECHANICS = re.compile(
    r"backlash|bearing|clearance|crank|curvature|cycloid|eccentric|elastic|friction|gear|hysteresis|lobe|mesh|\bpins?\b"
    r"|pressure|reducer|rigidity|roller|stiffness|tolerance|torque"
)


@pytest.fixture(scope="module")
def graph() -> grimp.ImportGraph:
    return grimp.build_graph("pipeline", "stages", include_external_packages=True, cache_dir=None)


def test_imports_point_one_way(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))
    config = str(ROOT / "pyproject.toml")
    assert lint_imports(config_filename=config, no_cache=True) == EXIT_STATUS_SUCCESS, "say `make lint` for the imports"


def test_every_room_has_its_place_in_the_order(graph: grimp.ImportGraph) -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    (layers,) = [contract["layers"] for contract in contracts if contract["id"] == "house"]
    placed = {room.strip() for layer in layers for room in re.split(r"[|:]", layer)}
    assert placed == graph.find_children("pipeline") | {"stages", "tests.validation"}


def test_the_model_imports_arrays_meshes_and_a_compiler_only(graph: grimp.ImportGraph) -> None:
    model = graph.find_descendants("pipeline.model")
    imported = {name for module in model for name in graph.find_modules_directly_imported_by(module)} - model
    imported -= {"pipeline.model", "pipeline.arrays", ERRORS, REGISTRY}
    assert {"numpy", "skfem"} <= imported
    assert imported - set(sys.stdlib_module_names) <= LIBRARIES_OF_THE_MODEL


def test_the_model_reads_no_file_and_no_setting(graph: grimp.ImportGraph) -> None:
    compiler = "pipeline.model.compiled"  # hashes the sources of what it compiles
    model = graph.find_descendants("pipeline.model") - {compiler}
    guilty = {module: graph.find_modules_directly_imported_by(module) & FILES_AND_SETTINGS for module in model}
    assert not {module: names for module, names in guilty.items() if names}
    assert graph.find_modules_directly_imported_by(compiler) & FILES_AND_SETTINGS


@pytest.mark.long
def test_a_report_loads_no_library_of_other_stages() -> None:
    program = "import sys, pipeline.library.running, stages.report; stages.report.library(); print(*sys.modules)"
    modules = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    assert {"scipy", "matplotlib.figure", "stages.hysteresis"} <= set(modules.split())
    assert not {"scipy.stats", "scipy.optimize", "scipy.sparse", "skfem", "meshio"} & set(modules.split())


def test_the_engine_knows_no_word_of_mechanics() -> None:
    files = sorted((ROOT / "pipeline/engine").rglob("*.py"))
    assert len(files) > 5
    examples = r'"\w+[./][\w./]+"'  # of a setting, a file, a table
    for file in files:
        text = re.sub(examples, "", file.read_text())
        assert not (word := MECHANICS.search(text)), f"{file.name}: {word and word.group()}"
