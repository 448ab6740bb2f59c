"""The reference of the keys covers every file of the project, and the files that `new` writes run."""

import shutil
import tomllib
from pathlib import Path

import pytest

from pipeline import cli, settings
from pipeline.cli.keys import BASES, FOLDERS, examples, file_keys, key_lines, written_keys
from pipeline.config import load_design, load_study
from pipeline.config.dimensions import dimension_library
from pipeline.identification.fitting.problem import candidates
from pipeline.model.effects.effect import NEEDS

ROOT = Path(__file__).parents[2]
FILES = [(kind, path) for kind, pattern in FOLDERS.items() for path in sorted(ROOT.glob(pattern))]
TOLD_APART = ("flank.measured", "effects.", "provenance.")
"""Keys whose value may be a file, and names that libraries give."""


@pytest.mark.parametrize(("kind", "path"), FILES, ids=lambda item: getattr(item, "stem", item))
def test_every_key_of_every_file_is_in_the_reference(kind, path):
    known = {key.path for key in file_keys()[kind]}
    keys = {key for key, _ in written_keys(kind, tomllib.loads(path.read_text()))}
    assert len(keys) > 3
    assert {key for key in keys if not key.startswith(TOLD_APART)} - known == set()


def test_types_bounds_units_defaults_and_examples_are_those_of_the_sections():
    by_path = {key.path: key for key in file_keys()["study"]}
    count = by_path["samples.count"]
    assert (count.kind, count.default, count.allowed_values) == ("integer", "required", ">= 1 and <= 1e+09")
    lower = by_path["tolerances.<dimension>.lower_um"]
    assert (lower.kind, lower.unit, lower.allowed_values) == ("number", "um", ">= -1000 and <= 1000")
    assert by_path["cycle.rigid_angles"].default == "181"
    assert by_path["reduce.patch_half_width_mm"].default == "a tenth of the pin's radius"
    assert '"monte_carlo", "sobol"' in by_path["samples.experiment"].allowed_values
    assert '"uniform"' in by_path["tolerances.<dimension>.distribution"].allowed_values, "choices of all distributions"
    assert by_path["temperature.disk_C"].unit == "deg C"
    assert float(examples(ROOT)["design", "cycloid.pin_radius_mm"]) > 0


def test_the_command_prints_one_part_and_the_signs(capsys):
    assert cli.main(["keys", "cycle"]) == 0
    out = capsys.readouterr().out
    assert "cycle.loaded_angles: integer" in out
    assert "cycloid.pins" not in out
    signs, everything = ("\n".join(key_lines(name)) for name in ("tolerances", ""))
    assert all(f"  {name}: " in lines for name in dimension_library() for lines in (signs, everything))
    assert "disk_profile: material off the whole flank; positive gives clearance; opens gaps; state convention" in signs
    assert "clearance.disk_reading, which is normal for a profile tolerance of ISO 1101: 0.008" in signs
    assert cli.main(["keys", "cyle"]) == 2
    assert "did you mean 'cycle'" in capsys.readouterr().err


def test_the_command_prints_every_effect_with_its_parameters(capsys):
    assert cli.main(["keys", "effects"]) == 0
    out = capsys.readouterr().out
    for effect in candidates().values():
        assert f"\n{effect.name}: {effect.title}\n" in f"\n{out}"
        assert all(f"  {parameter.name}: {parameter.meaning}" in out for parameter in effect.parameters)
        assert effect.needs <= set(NEEDS)
    assert "  torque_Nm: friction torque, referred to the output [N m]\n" in out
    assert "part of: the bench" in out


def test_what_new_writes_is_read_and_is_commented(tmp_path, monkeypatch, capsys):
    for path in BASES.values():
        source = ROOT / path
        target = tmp_path / path
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copytree(source, target) if source.is_dir() else shutil.copy(source, target)
    monkeypatch.setattr(settings, "ROOT", tmp_path)
    assert cli.main(["new", "design", "mine"]) == 0
    assert cli.main(["new", "study", "first", "--design", "mine"]) == 0
    assert cli.main(["new", "unit", "bench"]) == 0
    assert "next: make study STUDY=first" in capsys.readouterr().out
    assert load_design("mine", tmp_path) == load_design("pin_in_hole_39", ROOT)
    study = load_study("first", tmp_path)
    assert study.tolerances == load_study("pin_in_hole", ROOT).tolerances
    assert study.title.startswith("mine: spread of")
    written = (tmp_path / "data/studies/first.toml").read_text()
    assert not any(words in written for words in ("ratio 39", "40 pins", "Pins in holes", "1,872"))
    text = (tmp_path / "data/designs/mine.toml").read_text()
    assert "pin_radius_mm = 3.0" in text
    assert "# number [mm]; required; >= 0.001" in text
    assert (tmp_path / "data/measured/bench/rows.csv").is_file()
    assert cli.main(["new", "design", "mine"]) == 2
    assert "exists; take another name" in capsys.readouterr().err
    assert cli.main(["new", "study", "second", "--design", "nowhere"]) == 2
    assert cli.main(["new", "design", "../mine"]) == 2


def test_new_says_where_it_would_write_from(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(settings, "ROOT", tmp_path)
    for kind, path in BASES.items():
        assert cli.main(["new", kind, "mine"]) == 2
        message = capsys.readouterr().err
        assert f"{path}" in message
        assert f"a new {kind} is written from it; copy it from the checkout" in message
