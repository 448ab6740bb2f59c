"""Which files, settings and versions a result depends on, and what is said when one differs."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from toy_study import ADD, TOTAL, Numbers, Toy

from pipeline.engine import fingerprint as engine
from pipeline.engine.fingerprint import fingerprint, remembered_sources, source_hashes, used_settings
from pipeline.engine.record import with_seal
from pipeline.engine.runner import Resources, run
from pipeline.engine.stage import Job, Stage, Tables
from pipeline.errors import InputError
from pipeline.registry import METRICS

FILES = {
    "__init__.py": "",
    "root.py": "from {p}.near import f\nfrom . import beside\n\ndef solve():\n    from {p}.sub.late import g\n",
    "near.py": "import numpy as np\nfrom typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from {p} import typed\n"
    'def f(x):\n    """Double."""\n    return 2 * x\n',
    "beside.py": "from .sub.late import g\n",
    "sub/__init__.py": "from . import inner\n",
    "sub/inner.py": "A = 1\n",
    "sub/late.py": "from ..up import B as g\n",
    "up.py": "B = 1\n",
    "typed.py": "C = 1\n",
    "alone.py": "D = 1\n",
}


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    name = f"package_{tmp_path.name}"
    for file, text in FILES.items():
        path = tmp_path / name / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text.format(p=name))
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path / name


def edit(path: Path, files_before: str, text_after: str) -> None:
    text = path.read_text()
    assert files_before in text
    path.write_text(text.replace(files_before, text_after))


def test_sources_are_the_own_files_imported_directly_or_not(package: Path) -> None:
    result = {name.removeprefix(f"{package.name}/") for name in source_hashes(f"{package.name}.root")}
    assert result == set(FILES) - {"typed.py", "alone.py"}


def test_the_engine_is_a_source_but_its_progress_is_not() -> None:
    sources = source_hashes("toy_study")
    assert {"toy_study.py", "pipeline/__init__.py", "pipeline/engine/table.py", "pipeline/errors.py"} <= set(sources)
    assert "pipeline/engine/progress.py" not in sources


@pytest.mark.parametrize(
    ("file", "text_before", "text_after", "changes"),
    [
        ("near.py", '"""Double."""', '"""Twice."""', False),
        ("near.py", "return 2 * x", "return 2 * x  # why", False),
        ("near.py", "return 2 * x", "return (2*x)", False),
        ("near.py", "import typed", "import alone", False),
        ("near.py", "return 2 * x", "return 3 * x", True),
        ("sub/inner.py", "A = 1", "A = 2", True),
        ("up.py", "B = 1", "B = 2", True),
        ("alone.py", "D = 1", "D = 2", False),
    ],
)
def test_only_what_can_change_a_value_changes_a_hash(
    package: Path, file: str, text_before: str, text_after: str, changes: bool
) -> None:
    root = f"{package.name}.root"
    hashes_before = source_hashes(root)
    edit(package / file, text_before, text_after)
    differing = {name for name, digest in source_hashes(root).items() if digest != hashes_before.get(name)}
    assert differing == ({f"{package.name}/{file}"} if changes else set())


def test_what_a_run_has_read_is_remembered_by_content_and_rules(
    package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root, near = f"{package.name}.root", f"{package.name}/near.py"
    memory = tmp_path / "runs" / "sources.json"

    def hashes() -> dict[str, str]:
        """As a new process has them."""
        monkeypatch.setattr(engine, "_read_sources", {})
        engine._source.cache_clear()
        with remembered_sources(memory):
            return source_hashes(root)

    original = hashes()
    assert hashes() == original == source_hashes(root)
    content = json.loads(memory.read_text())
    (key,) = [key for key, (digest, _) in content["sources"].items() if digest == original[near]]
    remembered = "f" * 64
    content["sources"][key][0] = remembered
    memory.write_text(json.dumps(content))
    assert hashes() == original  # altered since it was written
    memory.write_text(json.dumps(with_seal(content)))
    assert hashes() == original | {near: remembered}
    edit(package / "near.py", "return 2 * x", "return 3 * x")
    assert hashes()[near] not in {remembered, original[near]}
    edit(package / "near.py", "return 3 * x", "return 2 * x")
    memory.write_text(json.dumps(with_seal(content | {"rules": "e" * 64})))
    assert hashes() == original
    for misshapen in ("no JSON", "[]", '{"sources": 1}', json.dumps(with_seal({**content, "sources": {key: [1]}}))):
        memory.write_text(misshapen)
        assert hashes() == original


def test_a_module_that_is_nowhere_is_a_mistake() -> None:
    with pytest.raises(TypeError, match="module nowhere.at_all: no source file"):
        source_hashes("nowhere.at_all")


def recorded(study: object, inputs: dict[str, str]) -> dict:
    """A fingerprint as it comes back from a record."""
    current = fingerprint(ADD, study, inputs)
    return json.loads(
        json.dumps(
            {k: getattr(current, k) for k in ("settings", "sources", "packages", "inputs")} | {"key": current.key}
        )
    )


def test_used_settings_count_and_others_do_not() -> None:
    key = fingerprint(ADD, Toy(), {}).key
    assert fingerprint(ADD, Toy(numbers=Numbers(seed=2)), {}).key == key
    assert fingerprint(ADD, Toy(numbers=Numbers(slope=3.0)), {}).key != key
    assert fingerprint(ADD, Toy(), {"draw/points": "a"}).key != key


def test_an_equal_fingerprint_has_no_changes() -> None:
    assert fingerprint(ADD, Toy(), {"draw/points": "a"}).changes_since(recorded(Toy(), {"draw/points": "a"})) == []


def test_each_change_is_a_plain_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    record_before = recorded(Toy(), {"draw/points": "a"})
    current = fingerprint(
        ADD, Toy(numbers=Numbers(slope=3.0), plan={"powers": [2]}), {"draw/points": "b", "draw/x": "c"}
    )
    sources = dict(current.sources) | {"toy_study.py": "0", "pipeline/new.py": "1"}
    del sources["pipeline/errors.py"]
    current = replace(current, sources=sources, packages=dict(current.packages) | {"numpy": "9.9"})
    assert current.changes_since(record_before) == [
        "setting numbers.slope changed: 2.0 -> 3.0",
        "setting plan.powers changed: [1, 2] -> [2]",
        "source pipeline/errors.py removed",
        "source pipeline/new.py added",
        "source toy_study.py changed",
        f"package numpy {record_before['packages']['numpy']} -> 9.9",
        "input draw/points changed",
        "input draw/x changed",
    ]


def test_settings_are_flat_and_lists_of_tables_are_numbered() -> None:
    study = Toy(plan={"cases": [{"label": "a", "x": [1, 2]}, {"label": "b"}], "none": {}})
    assert used_settings(ADD, study) == {
        "numbers.count": 40,
        "numbers.slope": 2.0,
        "plan.cases.0.label": "a",
        "plan.cases.0.x": [1, 2],
        "plan.cases.1.label": "b",
        "plan.none": {},
    }


def test_results_of_sources_that_change_meanwhile_are_not_kept(package: Path, tmp_path: Path) -> None:
    """Neither a table nor an entry of the cache: the code in memory is that of before, or of both."""

    def change_within_the_cache(job: Job) -> Tables:
        def make(folder: Path) -> None:
            (folder / "made.txt").write_text("by the old code")
            edit(package / "near.py", "2 * x", "3 * x")

        job.memo("made", make)
        return {"total": TOTAL.empty()}

    def change_after_it(job: Job) -> Tables:
        edit(package / "near.py", "2 * x", "3 * x")
        return {"total": TOTAL.empty()}

    for number, body in enumerate((change_within_the_cache, change_after_it)):
        stage = Stage("total", (), (), (TOTAL,), f"{package.name}.root", run=body)
        runs = tmp_path / f"runs{number}"
        with pytest.raises(InputError, match=r"near.py: changed while this command ran.*run the command again"):
            run([stage], Toy(), ["total"], runs, Resources(1, 4))
        assert not (runs / "toy/total/record.json").exists()
        assert not list(runs.glob(".cache/*/made.txt"))
        edit(package / "near.py", "3 * x", "2 * x")


def test_a_change_between_two_stages_is_refused_before_the_second(package: Path, tmp_path: Path) -> None:
    def first(job: Job) -> Tables:
        edit(package / "alone.py", "D = 1", "D = 2")
        return {"total": TOTAL.empty()}

    module = f"{package.name}.alone"
    stages = [
        Stage("before", (), (), (TOTAL,), f"{package.name}.root", run=first),
        Stage("after", ("before",), (), (TOTAL,), module, run=lambda job: {"total": TOTAL.empty()}),
    ]
    with pytest.raises(InputError, match=r"alone.py: changed while"):
        run(stages, Toy(), ["after"], tmp_path / "runs", Resources(1, 4))


def install(folder: Path, module: str) -> None:
    """An entry point of a metric, as an installed package has it."""
    info = folder / "lab-1.0.dist-info"
    info.mkdir(parents=True, exist_ok=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: lab\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[cycloid_metrics]\nwound = {module}:METRIC\n")


@pytest.mark.parametrize(
    ("module", "file"),
    [
        ("lab_without_init.metric", "lab_without_init/metric.py"),
        ("lab_without_init.metric", "lab_without_init/data/factor.csv"),
        ("lab_alone", "lab_alone.py"),
        ("lab_alone", "lab_alone.html"),
    ],
)
def test_all_files_of_a_registered_package_are_sources(tmp_path: Path, monkeypatch, module: str, file: str) -> None:
    """Of a package without ``__init__.py`` too, and what lies beside a single module under its name."""
    for name in ("lab_without_init/metric.py", "lab_without_init/data/factor.csv", "lab_alone.py", "lab_alone.html"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("A = 1\n")
    install(tmp_path, module)
    monkeypatch.syspath_prepend(tmp_path)
    before = source_hashes("pipeline.model.metrics")
    assert file in before
    (tmp_path / file).write_text("A = 2\n")
    after = source_hashes("pipeline.model.metrics")
    assert {name for name in after if after[name] != before.get(name)} == {file}


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("import a_library_that_is_missing\n", "ModuleNotFoundError: No module named 'a_library_that_is_missing'"),
        ("METRIC = (\n", "SyntaxError"),
        ("A = 1\n", "AttributeError"),
        ("METRIC = 3\n", "is int, which has no name"),
    ],
)
def test_a_package_that_cannot_be_loaded_is_named(tmp_path: Path, monkeypatch, text: str, found: str) -> None:
    name = f"lab_broken_{tmp_path.name}".replace("-", "_")
    (tmp_path / f"{name}.py").write_text(text)
    install(tmp_path, name)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(InputError) as refusal:
        METRICS.declarations()
    message = str(refusal.value)
    assert f"cycloid_metrics: wound = {name}:METRIC of package lab: {found}" in message
    assert "mend that package or uninstall it" in message
