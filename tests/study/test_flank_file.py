"""The section ``[flank]`` of a design and its CSV file: what they mean, and what is refused with its key or rows."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from pipeline import assembly
from pipeline.config import load_design, parse_design
from pipeline.config.changing import toml_of
from pipeline.errors import InputError
from pipeline.model.geometry.drawn_flank import lobe_length

ROOT = Path(__file__).parents[2]
BASE = tomllib.loads((ROOT / "data/designs/pin_in_hole_39.toml").read_text())
PHASES = np.arange(0, 360, 10)


def design(**flank):
    return parse_design({**BASE, "flank": flank}, "design.toml")


def refused(**flank):
    with pytest.raises(InputError) as raised:
        design(**flank)
    return " | ".join(raised.value.problems)


def from_csv(folder, text, name="flank.csv"):
    (folder / name).write_text(text)
    (folder / "design.toml").write_text(toml_of({**BASE, "flank": {"measured": name}}))
    return load_design(folder / "design.toml", ROOT)


def table(rows, columns="phase_deg,deviation_um"):
    return "\n".join([columns, *(",".join(f"{value:.9g}" for value in row) for row in rows)]) + "\n"


def test_a_design_without_the_section_is_as_its_pins_generate_it():
    profile = assembly.profile(parse_design(BASE, "design.toml"))
    assert profile.generating is profile
    assert not profile.modification.deviates


def test_numbers_of_the_section_in_the_units_of_the_model():
    modification = assembly.profile(
        design(equidistant_um=8.0, moved_distance_um=-5.0, rotation_arcmin=1.0)
    ).modification
    assert (modification.equidistant, modification.moved_distance) == (8e-3, -5e-3)
    assert modification.rotation == pytest.approx(np.pi / 180 / 60)


def test_a_file_by_phase_and_one_by_arc_are_one_flank(tmp_path):
    deviation = np.round(3 * np.sin(np.radians(PHASES)), 6)
    by_phase = assembly.profile(from_csv(tmp_path, table(zip(PHASES, deviation, strict=True))))
    arcs = np.linspace(0, 1, 361)[:-1] * lobe_length(by_phase)
    by_arc = assembly.profile(from_csv(tmp_path, table(((arc, 0.0) for arc in arcs), "arc_mm,deviation_um")))
    assert by_phase.modification.measured_flank.material[0] == pytest.approx(1e-3 * deviation)
    phase = by_arc.modification.measured_flank.phase
    assert phase[180] == pytest.approx(np.pi, abs=1e-6)  # half of a lobe's length is its tip
    assert np.all(np.diff(phase) > 0)


def test_a_list_a_lobe_and_a_design_written_with_its_flank(tmp_path):
    rows = [(lobe, phase, 0.1 * lobe) for lobe in range(39) for phase in PHASES]
    read = from_csv(tmp_path, table(rows, "lobe,phase_deg,deviation_um"))
    assert len(read.flank.measured.deviation_um) == 39
    repeat = parse_design(tomllib.loads(toml_of(read.model_dump())), "design.toml")
    assert assembly.profile(repeat) == assembly.profile(read)


@pytest.mark.parametrize(
    ("flank", "message"),
    [
        ({"equidistant_um": 2000.0}, "flank.equidistant_um = 2000.0; must be <= 1000"),
        ({"equidistant": 2.0}, "flank.equidistant"),
        ({"rotation_arcmin": -1.0}, "flank.rotation_arcmin = -1.0; must be >= 0"),
        ({"measured": {"phase_deg": list(range(0, 360, 10)), "deviation_um": [[0.0] * 35]}}, "35 values"),
        ({"measured": {"phase_deg": [0.0, 10.0], "deviation_um": [[0.0, 0.0]]}}, "2 points"),
        ({"measured": {"deviation_um": [[0.0]]}}, "must have phase_deg or arc_mm"),
    ],
)
def test_impossible_sections_are_refused(flank, message):
    assert message in refused(**flank)


@pytest.mark.parametrize(
    ("cycloid", "flank", "message"),
    [
        ({"pin_radius_mm": 0.05, "eccentricity_mm": 1.73}, {"moved_distance_um": -900.0}, "has loops"),
        ({"eccentricity_mm": 1.6}, {"equidistant_um": 900.0}, "must be < .*, or the drawn flank is undercut"),
    ],
)
def test_an_undercut_drawn_flank_and_one_with_loops_are_refused(cycloid, flank, message):
    possible = {**BASE, "cycloid": {**BASE["cycloid"], **cycloid}}
    parse_design(possible, "design.toml")
    with pytest.raises(InputError, match=message):
        parse_design({**possible, "flank": flank}, "design.toml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "flank.csv"),
        ("phase_deg,deviation_um\n", "no rows"),
        (table([(p, 0) for p in PHASES], "angle,deviation_um"), 'column "angle" is unknown'),
        (table([(p, 0) for p in PHASES]).replace("20,0", "20,x"), 'flank.csv:4: deviation_um = "x"; must be a number'),
        (
            table([(p, 0) for p in (*PHASES[:5], 35, *PHASES[5:])]),
            "flank.csv:6 and flank.csv:7 = 35.0; stands after 40",
        ),
        (table([(p, 0) for p in PHASES[:20]]), "flank.csv:21 = 190.0; no point in the next 170 deg"),
        (table([(p, 700 * (p == 60)) for p in range(0, 360, 2)]), "folds or cuts itself"),
        (table([(p, 0) for p in range(0, 400, 10)]), "must be < 360"),
        (table([(k, p, 0) for k in (0, 2) for p in PHASES], "lobe,phase_deg,deviation_um"), "lobe = 2 in row 38"),
        (table([(k, p, 0) for k in (0, 1) for p in PHASES], "lobe,phase_deg,deviation_um"), "must be 1, or 39"),
        (
            table([(k, p + k, 0) for k in range(39) for p in PHASES], "lobe,phase_deg,deviation_um"),
            "must be 0 as in row 2: all lobes are measured at the same points",
        ),
        ("\0\1", "zero bytes"),
    ],
)
def test_a_bad_flank_file_is_refused_with_its_rows(tmp_path, text, message):
    with pytest.raises(InputError) as raised:
        from_csv(tmp_path, text)
    assert message in " | ".join(raised.value.problems)
    assert all("Traceback" not in line for line in raised.value.problems)


def test_a_missing_file_is_named(tmp_path):
    (tmp_path / "design.toml").write_text(toml_of({**BASE, "flank": {"measured": "nowhere.csv"}}))
    with pytest.raises(InputError, match=r'design.toml: flank.measured = "nowhere.csv"; no such file'):
        load_design(tmp_path / "design.toml", ROOT)
