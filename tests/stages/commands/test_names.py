"""Legal but odd names go through every command to the page; illegal ones are refused before anything runs."""

import os
import re
import shutil
import subprocess
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest
from small_study import save_named

from pipeline import cli, settings
from pipeline.config.changing import toml_of
from pipeline.figures import style

ROOT = Path(__file__).parent.parent.parent.parent
STEM = "größe_滚轮.v2+a-b"
MATERIAL = "1.3505 $x_%{} 钢"
LABELS = (r"$\frac", "50 % of_it & <b>", "滚轮 Übermaß " + "x" * 200)


@pytest.fixture
def folder(tmp_path: Path, new_runs: Callable[[], Path], monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a blank in its path, a design whose material is named by its number, and runs of its own."""
    home = tmp_path / "a folder"
    home.mkdir()
    design = (ROOT / "data/designs/pham2017.toml").read_text()
    name = re.search(r"^material = \"(.*)\"", design, re.M)[1]
    design = design.replace(f'"{name}"', f"'{MATERIAL}'").replace(f"[materials.{name}]", f"[materials.'{MATERIAL}']")
    design = re.sub(rf'materials\.{name}\.(\w+)"', rf'materials.{MATERIAL}.\1"', design)
    (home / f"{STEM}.toml").write_text(design)
    monkeypatch.setattr(settings, "RUNS", new_runs())
    return home


def study_file(folder: Path, text: str) -> Path:
    """A rigid study of the odd design."""
    path = folder / f"s-{STEM}.toml"
    text = re.sub(r'^design = ".*"', f"design = '{folder / STEM}.toml'", text, flags=re.M)
    path.write_text(text.replace("[reduce]", '[reduce]\ndisk = "rigid"') if "[reduce]" in text else text)
    return path


@pytest.mark.long
def test_odd_names_reach_every_page(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """Figures with the material and the labels of cases are printed in the next test."""
    monkeypatch.setattr(style, "save", save_named("reducer"))
    text = (ROOT / "data/studies/quick.toml").read_text().replace("count = 50", "count = 4")
    text = re.sub(r"\[model_forms\]\n.*\n", "", text).replace("levels_per", "rigid_angles = 7\nlevels_per")
    study = study_file(folder, re.sub(r'^title = ".*"', "title = '''$\\\\frac %s <b>滚轮</b> ü'''", text, flags=re.M))
    for command in (
        ["run", "report", "--study", study, "--jobs", "1"],
        ["why", "report", "--study", study],
        ["show", study.stem],
        ["check", study.stem],
        ["provenance", study.stem],
        ["joints", "--study", study, "--jobs", "1"],
    ):
        assert cli.main([str(part) for part in command]) == 0, capsys.readouterr().err
    page = (settings.RUNS / study.stem / "report/report.html").read_text()
    assert "1.3505 $x_%{} 钢" in page
    assert "<b>滚轮</b>" not in page  # a title is no markup
    assert "up to date" in capsys.readouterr().out


@pytest.mark.long
def test_labels_of_cases_reach_page_and_figures(folder: Path, capsys: pytest.CaptureFixture) -> None:
    settings_of_study = tomllib.loads((ROOT / "data/studies/quick.toml").read_text())
    kept = {
        name: settings_of_study[name] for name in ("design", "cycle", "reduce", "springs") if name in settings_of_study
    }
    kept["cycle"]["rigid_angles"] = 7
    cases = [{"label": label, "pin_radial": float(k)} for k, label in enumerate(LABELS)]
    study = study_file(folder, toml_of({**kept, "samples": {"experiment": "cases"}, "cases": cases}))
    assert cli.main(["run", "report", "--study", str(study), "--jobs", "1"]) == 0, capsys.readouterr().err
    page = (settings.RUNS / study.stem / "report/report.html").read_text()
    assert r"$\frac" in page
    assert "of_it &amp; &lt;b&gt;" in page


@pytest.mark.parametrize("name", ["a b", "a;b", "-rf", ".hidden", "a" * 61, "a$b", "\x1b[31mred"])
def test_illegal_names_are_refused_for_studies_and_units(
    folder: Path, capsys: pytest.CaptureFixture, name: str
) -> None:
    path = folder / f"{name}.toml"
    shutil.copy(ROOT / "data/studies/quick.toml", path)
    assert cli.main(["run", "sample", "--study", str(path)]) == 2
    unit = folder / name
    shutil.copytree(ROOT / "data/measured/friction_example", unit)
    assert cli.main(["identify", "--unit", str(unit)]) == 2
    said = capsys.readouterr()
    assert said.err.count("must be letters, digits") == 2
    assert "\x1b" not in said.err + said.out


def test_terminal_codes_are_shown_and_not_obeyed(folder: Path, capsys: pytest.CaptureFixture) -> None:
    path = folder / "s.toml"
    path.write_text((ROOT / "data/studies/quick.toml").read_text() + '\n["\\u001b[31mred\\u202e"]\na = 1\n')
    assert cli.main(["run", "sample", "--study", str(path)]) == 2
    with pytest.raises(SystemExit):
        cli.main(["run", "\x1b[31mred", "--\x1b[5m"])
    said = capsys.readouterr().err
    assert r"\x1b[31mred\u202e" in said
    assert "\x1b" not in said


@pytest.mark.skipif(not shutil.which("make"), reason="make is not installed")
@pytest.mark.parametrize("target", ["why", "study", "check", "compare A=x B", "identify UNIT"])
def test_make_runs_no_command_that_a_variable_holds(tmp_path: Path, target: str) -> None:
    """`make why STUDY='quick; echo X > y'` ran a command of the shell; a path with a blank was two arguments."""
    variable = {"compare A=x B": "B", "identify UNIT": "UNIT"}.get(target, "STUDY")
    goal, *given = target.removesuffix(f" {variable}").split()
    program = tmp_path / ".venv/bin/python"
    program.parent.mkdir(parents=True)
    program.write_text('#!/bin/sh\nfor word in "$@"; do printf "[%s]\\n" "$word"; done\n')
    program.chmod(0o755)
    shutil.copy(ROOT / "Makefile", tmp_path)
    for name in ("pyproject.toml", "constraints.txt"):
        (tmp_path / name).touch()
    (tmp_path / "stages").mkdir()
    shutil.copy(ROOT / "stages/chain.py", tmp_path / "stages")
    (tmp_path / ".venv/installed").touch()
    value = "a b'; touch y; `touch y` \"|&>y $(shell touch y) $(touch y) $$HOME"
    command = ["make", "-s", goal, *given, f"{variable}={value}"]
    environment = {name: text for name, text in os.environ.items() if not name.startswith("MAKE")}
    process = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert process.returncode == 0, process.stderr
    assert f"[{value}]" in process.stdout.splitlines()
    assert not (tmp_path / "y").exists()


def test_the_makefile_takes_every_variable_as_text() -> None:
    """`make why STUDY='$(shell touch y)'` ran a command of make, before any shell."""
    text = (ROOT / "Makefile").read_text()
    (given,) = re.findall(r"^GIVEN := (.*)$", text, re.M)
    assert set(re.findall(r'"\$\$([A-Z]+)"', text)) | {"ALSO"} == set(given.split())


def test_every_variable_of_a_user_is_quoted_in_the_makefile() -> None:
    """Recipes name it as "$$NAME", or test whether it is given; $(NAME) itself would be read by the shell."""
    ours = {"PIPELINE", "VENV", "JOBS_OPTION", "NO_PYTHON", "PLAIN_STAGES", "SUITS", "PYTHON", "MAKE", "VALIDATION"}
    recipes = [line for line in (ROOT / "Makefile").read_text().splitlines() if line.startswith("\t")]
    expanded = {name for line in recipes for name in re.findall(r"(?<!if )\$\((\w+)\)", line)}
    assert expanded <= ours
