"""What another package declares: registered by an entry point, it is used as that of the project."""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from foreign_packages import ARCSINE, DOGS, FOUR_LOBED, IDLE, LINEAR, PLAY, RUBBER, WINDUP
from scipy import stats
from small_study import ROOT, run_study, small_study

from pipeline.config import load_study
from pipeline.config.designs.problems import effect_problems
from pipeline.engine.fingerprint import source_hashes
from pipeline.errors import InputError
from pipeline.identification.fitting.problem import candidates
from pipeline.model.contact.line_laws import library as laws
from pipeline.model.effects import library
from pipeline.registry import (
    CONTACT_LAWS,
    DIMENSIONS,
    DISTRIBUTIONS,
    EFFECTS,
    KINDS,
    METRICS,
    OUTPUT_MECHANISMS,
    REPORT_SECTIONS,
    TURN_METRICS,
    Kind,
)
from pipeline.report.inputs import law_fact

DRAW = """
import sys
from pathlib import Path
from pipeline import cli
from pipeline import settings
from pipeline.config import load_study
from pipeline.engine.fingerprint import source_hashes
from pipeline.report.inputs import tolerance_rows
assert {"arcsine_of_a_chatter.py", "chuck_of_four_jaws.py"} <= set(source_hashes("stages.sample"))
settings.RUNS = Path(sys.argv[1])
for study in sys.argv[2:]:
    status = cli.main(["run", "sample", "--study", study, "--jobs", "1"])
    print("ended", status)
    if status == 0:
        print(*tolerance_rows(load_study(study, Path()).tolerances), sep="\\n")
"""
RUN = """
import sys
from pathlib import Path
from pipeline import cli
from pipeline import settings
settings.RUNS = Path(sys.argv[1])
from pipeline.figures import style
from small_study import save_named
style.save = save_named("output_loads", "rigid_play")
for study, stage in zip(sys.argv[2::2], sys.argv[3::2]):
    print("ended", cli.main(["run", stage, "--study", study, "--jobs", "1"]))
"""
MEASURED = """
import sys
from pathlib import Path
import numpy as np
from pipeline.identification.results.prediction_errors import LoopError
from pipeline.model.metrics import Definitions, LoopReadings, measurable_metrics
from pipeline.populations.comparison import load_population
from pipeline.report.unit.rows import loop_row
from pipeline.identification.selection.held_out import STAGES
print(list(load_population(Path(sys.argv[1]))))
row = loop_row("windup_arcmin", LoopError(7.0, dict.fromkeys(STAGES, 7.0), 1))
print(row["title"], row["unit"])
loop = LoopReadings.from_bench(zero_falling=np.ones(1), high_plus=np.full(1, 5.0), high_minus=np.full(1, -4.0))
print(measurable_metrics()["windup_arcmin"].value(loop, Definitions(0.36, 6.0, 12.0))[0])
"""


QUICK = re.sub(r"\[model_forms\]\n.*\n", "", (ROOT / "data/studies/quick.toml").read_text())
QUICK = QUICK.replace("levels_per_branch", "rigid_angles = 7\nlevels_per_branch")
"""Solved under no other laws and bodies, which take longer than all else, and of rigid bodies at few crank angles."""


WINDUP_LIMIT = 10.92
"""Kept by two of the four units [arcmin]."""


def install(folder: Path, module: str, source: str, name: str, kind: Kind) -> None:
    """Lay a package of one module into the folder as an installer would, with the entry point of what it declares."""
    (folder / f"{module}.py").write_text(source)
    info = folder / f"{module}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{kind.group}]\n{name} = {module}:{kind.attribute}\n")


def install_rubber(folder: Path, name: str) -> None:
    install(folder, f"rubber_of_{name}", RUBBER.format(name=name), name, EFFECTS)


def in_a_process(program: str, folder: Path, *arguments: Path | str) -> subprocess.CompletedProcess[str]:
    """What a new process does, which finds the packages of the folder."""
    path = {**os.environ, "PYTHONPATH": os.pathsep.join((str(folder), str(ROOT), str(Path(__file__).parent)))}
    command = [sys.executable, "-c", program, *map(str, arguments)]
    return subprocess.run(command, env=path, cwd=ROOT, capture_output=True, text=True)


def endings(process: subprocess.CompletedProcess[str]) -> list[int]:
    """Exit status of each command that a process has run."""
    return [int(status) for status in re.findall(r"^ended (\d)$", process.stdout, re.M)]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.syspath_prepend(tmp_path)
    for declared in (library, laws):
        declared.cache_clear()
    yield tmp_path
    for declared in (library, laws):
        declared.cache_clear()


@pytest.mark.long
def test_an_effect_of_another_package_runs_in_a_study_and_is_tried(folder: Path, runs: Path) -> None:
    assert list(effect_problems({"rubber": {"twist": 50.0}}))
    library.cache_clear()
    install_rubber(folder, "rubber")
    assert library()["rubber"].title == "rubber coupling"
    assert "rubber" in candidates()
    assert not list(effect_problems({"rubber": {"twist": 50.0}}))
    assert "rubber_of_rubber.py" in source_hashes("pipeline.mounting")
    rigidity = []
    for name, effects in (("stiff", {}), ("rubber", {"rubber": {"twist": 50.0}})):
        study = small_study(count=2).model_copy(update={"name": name})
        design = study.design.model_copy(update={"effects": effects})
        outputs = run_study(study.model_copy(update={"design": design}), runs)
        rigidity.append(outputs["aggregate"].read("metrics")["torsional_rigidity_Nm_per_arcmin"])
    softer = 1e3 * 50e-9 * np.degrees(1) * 60  # [arcmin/(N m)] in series
    np.testing.assert_allclose(1 / rigidity[1], 1 / rigidity[0] + softer, rtol=2e-3)


def test_an_effect_with_the_name_of_another_is_refused(folder: Path) -> None:
    install_rubber(folder, "creep")
    with pytest.raises(InputError, match="rubber_of_creep:EFFECT: creep is declared already"):
        library()


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.group)
def test_a_file_that_was_copied_and_not_renamed_is_refused(kind: Kind, tmp_path: Path, monkeypatch) -> None:
    """Of every kind, and whether the copy is found before its original or after it."""
    original = sorted(kind.declarations())[0]
    package = importlib.import_module(kind.package)
    (tmp_path / "copied.py").write_text(
        f"from types import SimpleNamespace\n{kind.attribute} = SimpleNamespace(name={original!r})\n"
    )
    for paths in ([*package.__path__, str(tmp_path)], [str(tmp_path), *package.__path__]):
        monkeypatch.setattr(package, "__path__", paths)
        with pytest.raises(InputError, match=f"{original} is declared already; give it another name"):
            kind.declarations()


def test_effects_of_every_file_of_the_project_are_in_the_library_without_registration(folder: Path) -> None:
    files = {path.stem for path in (ROOT / "pipeline/model/effects").rglob("*.py")}
    assert {effect.apply.__module__.rpartition(".")[2] for effect in library().values()} == files - {
        "effect",
        "__init__",
    }


@pytest.fixture(scope="module")
def run_studies(tmp_path_factory: pytest.TempPathFactory, runs: Path) -> subprocess.CompletedProcess[str]:
    """Runs of the quick study with a metric, a section of the report and an output of other packages, by one process.

    One of the outputs is refused.
    """
    folder = tmp_path_factory.mktemp("packages")
    install(folder, "windup_of_a_loop", WINDUP.format(), "windup", METRICS)
    install(folder, "play_of_rigid_bodies", PLAY, "play", REPORT_SECTIONS)
    install(folder, "coupling_of_dogs", DOGS, "dogs", OUTPUT_MECHANISMS)
    refused, narrow, wide = (with_dogs(folder, *numbers) for numbers in ((3.0, 5.0), (15.0, 5.0), (15.0, 15.0)))
    wide.write_text(wide.read_text().replace("[limits]", f"[limits]\nwindup_arcmin = {WINDUP_LIMIT}"))
    stages = (refused, "report", narrow, "clearance", wide, "report")
    return in_a_process(RUN, folder, runs, *stages)


@pytest.fixture(scope="module")
def extended_run(run_studies: subprocess.CompletedProcess[str], runs: Path) -> Path:
    assert endings(run_studies) == [2, 0, 0], run_studies.stderr
    return runs / "dogs_15_15"


@pytest.mark.long
def test_a_metric_of_another_package_is_one_of_measured_units_too(tmp_path: Path) -> None:
    """In the table of a measured unit, read by its declaration alone, and a column of a population."""
    install(tmp_path, "windup_of_a_loop", WINDUP.format(), "windup", METRICS)
    (tmp_path / "units.csv").write_text("unit,windup_arcmin\na,7.1\nb,7.3\n")
    process = in_a_process(MEASURED, tmp_path, tmp_path / "units.csv")
    assert process.stdout.split("\n")[:3] == ["['unit', 'windup_arcmin']", "Windup at full torque arcmin", "9.0"], (
        process
    )


@pytest.mark.long
def test_a_metric_of_another_package_is_computed_limited_and_reported(extended_run: Path) -> None:
    aggregate = extended_run / "aggregate"
    metrics = pd.read_parquet(aggregate / "metrics.parquet")
    curves = pd.read_parquet(extended_run / "hysteresis" / "curves.parquet")
    swing = curves.groupby(["sample", "crank_deg"], observed=True)["angle_arcmin"].agg(np.ptp)
    np.testing.assert_allclose(metrics.set_index(["sample", "crank_deg"])["windup_arcmin"], swing, rtol=1e-9)
    units = pd.read_parquet(aggregate / "units.parquet")
    np.testing.assert_array_equal(units["windup_arcmin_worst"], metrics.groupby("sample")["windup_arcmin"].max())
    rows = pd.read_parquet(aggregate / "distributions.parquet")
    (kept_items,) = rows[rows.eval("metric == 'windup_arcmin' and over == 'worst' and statistic == 'yield'")]["value"]
    assert 0 < kept_items == np.mean(units["windup_arcmin_worst"][1:] <= WINDUP_LIMIT) < 1
    page = (extended_run / "report" / "report.html").read_text()
    assert "Windup at full torque" in page
    assert re.search(r"Difference in angle between \+12 and -12", page)


def test_a_metric_of_the_turn_of_another_package_is_a_source(folder: Path) -> None:
    install(folder, "sway_over_a_turn", "TURN_METRIC = None", "sway", TURN_METRICS)
    assert "sway_over_a_turn.py" in source_hashes("stages.aggregate")


def test_a_contact_law_of_another_package_is_known_and_told(folder: Path) -> None:
    text = QUICK.replace("count = 50", "count = 2")
    study = folder / "springy.toml"
    study.write_text(text.replace('"hertz"', '"hooke"'))
    with pytest.raises(InputError, match="springs.law = \"hooke\"; must be 'hertz' or 'linear' or 'palmgren'"):
        load_study(study, ROOT)
    laws.cache_clear()
    install(folder, "springs_of_hooke", LINEAR, "hooke", CONTACT_LAWS)
    assert "springs_of_hooke.py" in source_hashes("stages.springs")
    assert "springs_of_hooke.py" not in source_hashes("stages.sample")
    springy = load_study(study, ROOT)
    assert law_fact(springy) == "linear springs (Hooke, 1678)"


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory, runs: Path) -> tuple[Path, subprocess.CompletedProcess[str]]:
    """Folder of studies with a distribution and with a dimension of other packages, and the process that drew them."""
    folder = tmp_path_factory.mktemp("drawn")
    head, tail = QUICK.replace("count = 50", "count = 100").split("[tolerances.pin_tangential]")
    chatter = "[tolerances.pin_tangential]".join((head, tail.replace('"normal"', '"arcsine"', 1)))
    clamped = QUICK.replace("count = 50", "count = 20")
    clamped += '\n[tolerances.ovality_4]\ndistribution = "uniform"\nlower_um = 1.0\nupper_um = 3.0\n'
    texts = {
        "chatter": chatter,
        "clamped": clamped,
        "chatter_refused": chatter.replace("upper_um = 3.0", "upper_um = -4.0"),
        "clamped_refused": clamped.replace("lower_um = 1.0", "lower_um = -1.0"),
    }
    for name, text in texts.items():
        (folder / f"{name}.toml").write_text(text)
        with pytest.raises(InputError):
            load_study(folder / f"{name}.toml", ROOT)
    install(folder, "arcsine_of_a_chatter", ARCSINE + "DISTRIBUTION = Arcsine", "arcsine", DISTRIBUTIONS)
    install(folder, "chuck_of_four_jaws", FOUR_LOBED, "ovality_4", DIMENSIONS)
    return folder, in_a_process(DRAW, folder, runs, *(folder / f"{name}.toml" for name in texts))


def test_a_distribution_of_another_package_is_checked_drawn_and_told(drawn, runs: Path) -> None:
    folder, process = drawn
    assert endings(process) == [0, 0, 2, 2], process.stderr
    with pytest.raises(InputError, match=r"(?s)tolerances.pin_tangential.distribution.*arcsine"):
        load_study(folder / "chatter.toml", ROOT)
    assert "title='tangential pin position', distribution='arcsine'" in process.stdout
    assert "a vibration of amplitude 3 µm" in process.stdout
    pins = pd.read_parquet(runs / "chatter" / "sample" / "pins.parquet")
    draws = pins[pins["sample"] > 0]["tangential_um"]
    assert stats.kstest(draws, stats.arcsine(-3, 6).cdf).pvalue > 0.01
    assert "tolerances.pin_tangential.upper_um = -4.0; must be > lower_um = -3" in process.stderr


def test_a_dimension_of_another_package_is_drawn_acts_and_is_told(drawn, runs: Path) -> None:
    folder, process = drawn
    assert endings(process) == [0, 0, 2, 2], process.stderr
    with pytest.raises(InputError, match="tolerances.ovality_4"):
        load_study(folder / "clamped.toml", ROOT)
    assert "title='four-lobed ovality of pin circle', distribution='uniform', lower='1', upper='3'" in process.stdout
    reducer, pins = (pd.read_parquet(runs / "clamped" / "sample" / f"{name}.parquet") for name in ("reducer", "pins"))
    waves = np.fft.fft(pins["radial_um"].to_numpy().reshape(21, 80))[1:, 4] / 40
    amplitude, phase = (reducer[f"ovality_4_{name}"].to_numpy()[1:] for name in ("amplitude_um", "phase_rad"))
    assert np.all((amplitude >= 1) & (amplitude <= 3))
    # what is left of the fourth wave is the drift of the seats, of standard deviation 1 um over 80 pins
    assert np.max(np.abs(waves - amplitude * np.exp(4j * phase))) < 1.5 < np.max(np.abs(waves))
    assert "tolerances.ovality_4.lower_um = -1.0; must be >= 0" in process.stderr


@pytest.mark.long
def test_a_dimension_that_acts_on_nothing_is_refused(folder: Path) -> None:
    install(folder, "colour_of_a_disk", IDLE, "colour", DIMENSIONS)
    process = in_a_process("import pipeline.sampling.errors", folder)
    assert "dimension colour acts on nothing; give it a shift, or a gap in the model" in process.stderr


def with_dogs(folder: Path, radius: float, clearance: float) -> Path:
    """The quick study of the paper's design with another output."""
    text = (ROOT / "data/designs/pham2017.toml").read_text()
    head, _, tail = text.partition("[output]")
    numbers = re.sub(r'^"output\..*\n', "", tail[tail.index("[provenance]") :], flags=re.MULTILINE)
    output = f'[output]\nmechanism = "dogs"\nradius_mm = {radius}\nclearance_um = {clearance}\n\n'
    name = f"dogs_{radius:.0f}_{clearance:.0f}"
    (folder / f"of_{name}.toml").write_text(head + output + numbers)
    text = QUICK.replace("count = 50", "count = 4").replace("keep_contacts = [0]", 'keep_contacts = "all"')
    text = text.replace("[reduce]", '[reduce]\ndisk = "rigid"')
    study = folder / f"{name}.toml"
    study.write_text(text.replace('design = "pham2017"', f'design = "of_{name}.toml"'))
    return study


@pytest.mark.long
def test_a_mechanism_of_another_package_is_checked_run_drawn_and_told(
    run_studies: subprocess.CompletedProcess[str], folder: Path, runs: Path
) -> None:
    with pytest.raises(InputError, match="mechanism = \"dogs\"; must be one of 'carrier', 'direct', 'pin_in_hole', "):
        load_study(with_dogs(folder, 15.0, 5.0), ROOT)
    assert endings(run_studies) == [2, 0, 0], run_studies.stderr
    assert "output.radius_mm = 3.0; must be > 3 mm, the bore" in run_studies.stderr
    plays = []
    for name in ("dogs_15_5", "dogs_15_15"):
        run = runs / name
        plays.append(pd.read_parquet(run / "clearance" / "kinematic.parquet")["backlash_arcmin"].to_numpy())
    wider = np.degrees(2 * 10e-3 / 15.0) * 60  # both senses turn through 10 um at 15 mm
    np.testing.assert_allclose(plays[1] - plays[0], wider, rtol=1e-9)
    contacts = pd.read_parquet(run / "clearance" / "contacts.parquet")
    forces = pd.read_parquet(run / "hysteresis" / "contacts.parquet").merge(contacts)
    dogs = forces[forces["kind"] == "output"]
    assert set(dogs["label"]) == {f"dog {k}" for k in range(4)}
    dogs = dogs.assign(moment=1e-3 * dogs["force_N"] * dogs["arm_mm"])
    steps = dogs.groupby(["sample", "crank_deg", "step"], observed=True)
    np.testing.assert_allclose(steps["moment"].sum(), -steps["torque_Nm"].first(), rtol=1e-6)
    page = (run / "report" / "report.html").read_text()
    for words in ("four dogs 15\u00a0mm off the axis", "Forces on the dogs", "Dogs are round."):
        assert words.replace("\u00a0", " ") in page.replace("\u00a0", " ")


def test_a_section_of_another_package_is_a_source(folder: Path) -> None:
    assert "play_of_rigid_bodies.py" not in source_hashes("stages.chain")
    install(folder, "play_of_rigid_bodies", PLAY, "play", REPORT_SECTIONS)
    assert "play_of_rigid_bodies.py" in source_hashes("stages.chain")


@pytest.mark.long
def test_a_section_of_another_package_stands_on_the_page(extended_run: Path) -> None:
    kinematic = pd.read_parquet(extended_run / "clearance" / "kinematic.parquet")
    page = (extended_run / "report" / "report.html").read_text().replace("\u00a0", " ")
    contents = re.findall(r'<li><a href="#(\w+)">([^<]*)</a></li>', page)
    assert [name for name, _ in contents] == re.findall(r'<section id="(\w+)">', page)
    position = contents.index(("play", "Play &lt;rigid&gt;"))
    assert [contents[position - 1][0], contents[position + 1][0]] == ["load", "curve"]
    section = page.partition('<section id="play">')[2].partition("</section>")[0]
    assert "<h2>Play &lt;rigid&gt;</h2>" in section
    assert f"{len(kinematic):,} rows, at most {kinematic['backlash_arcmin'].max():.6f} arcmin." in section
    numbers = [int(number) for number in re.findall(r"<b>Figure (\d+)[a-z]?\. ", page)]
    assert sorted(set(numbers)) == list(range(1, max(numbers) + 1))
    assert re.search(r"<b>Figure \d+\. Play of rigid bodies\.</b> Of every sample\.", section)
    assert (extended_run / "report" / "figures" / "rigid_play.png").stat().st_size > 1000
