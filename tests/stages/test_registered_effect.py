"""An effect of another package: registered by an entry point, it is in the library, in designs and in fingerprints."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, run_study, small_study

from pipeline.config.effects import effect_problems
from pipeline.engine.fingerprint import source_hashes
from pipeline.identification.fitting.problem import candidates
from pipeline.model.effects import library
from pipeline.model.effects.effect import ENTRY_POINTS

RUBBER = """
from dataclasses import replace
from pipeline.model.effects import Effect, Parameter
EFFECT = Effect(
    name="{name}", title="rubber coupling", physics="twists in proportion to the torque", source="Hooke",
    parameters=(Parameter("twist", "1", "rotation per torque [1e-9 rad/(N mm)]"),),
    changes="torsion", signature="softer", confused_with=("output_torsion",), told_apart_by="the coupling alone",
    bounds=lambda drive: ((0.0, 100.0),),
    apply=lambda drive, values, conditions: replace(drive, torsion=drive.torsion + 1e-9 * values[0]),
)
"""


def install(folder: Path, name: str) -> None:
    (folder / f"rubber_of_{name}.py").write_text(RUBBER.format(name=name))
    info = folder / f"rubber_of_{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: rubber_of_{name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{ENTRY_POINTS}]\n{name} = rubber_of_{name}:EFFECT\n")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.syspath_prepend(tmp_path)
    library.cache_clear()
    yield tmp_path
    library.cache_clear()


def test_an_effect_of_another_package_runs_in_a_study_and_is_tried(folder: Path) -> None:
    assert list(effect_problems({"rubber": {"twist": 50.0}}))
    library.cache_clear()
    install(folder, "rubber")
    assert library()["rubber"].title == "rubber coupling"
    assert "rubber" in candidates()
    assert not list(effect_problems({"rubber": {"twist": 50.0}}))
    assert "rubber_of_rubber.py" in source_hashes("pipeline.mounting")
    rigidity = []
    for name, effects in (("plain", {}), ("rubber", {"rubber": {"twist": 50.0}})):
        study = small_study(count=2).model_copy(update={"name": name})
        design = study.design.model_copy(update={"effects": effects})
        outputs = run_study(study.model_copy(update={"design": design}), folder)
        rigidity.append(outputs["aggregate"].read("metrics")["torsional_rigidity_Nm_per_arcmin"])
    softer = 1e3 * 50e-9 * np.degrees(1) * 60  # [arcmin/(N m)] in series
    np.testing.assert_allclose(1 / rigidity[1], 1 / rigidity[0] + softer, rtol=2e-3)


def test_an_effect_with_the_name_of_another_is_refused(folder: Path) -> None:
    install(folder, "creep")
    with pytest.raises(ValueError, match="rubber_of_creep:EFFECT: creep is declared already"):
        library()


def test_the_library_of_the_project_needs_no_registration(folder: Path) -> None:
    files = {path.stem for path in (ROOT / "pipeline/model/effects").glob("*.py")}
    assert set(library()) == {name for name in files if not name.startswith("_")} - {"effect"}
