"""Files that are no table, not what their name says, or larger than a table: a named error, in bounded memory."""

import bz2
import gzip
import lzma
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from measured_bench import ROOT, UNIT, measured, write_unit

from pipeline.config.files.table_file import read_table
from pipeline.errors import InputError
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.populations.comparison import load_population

CSV = measured().to_csv(index=False).encode()
PACKED = gzip.compress(CSV)
ONE_CYCLE = measured(cycles=1, positions=(0.0,))
MEMORY = """
import re, sys
from pathlib import Path
from pipeline.errors import InputError
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.config.files import table_file
table_file.LARGEST_TEXT = 1 << 27
def peak():  # of this process alone: what getrusage says includes the parent's
    return int(re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())[1]) / 1024
unit = load_measured_unit(sys.argv[1], Path(sys.argv[2]))
before = peak()
try:
    print(len(Measurement.read(unit).rows), "rows")
except InputError as error:
    print(error)
print(before, peak())
"""


def read(folder: Path) -> Measurement:
    return Measurement.read(load_measured_unit(folder, ROOT))


def with_file(folder: Path, name: str, content: bytes) -> Path:
    (write_unit(folder, {}) / name).write_bytes(content)
    text = UNIT if name.endswith((".csv", ".csv.gz")) else UNIT + f'[[files]]\npath = "{name}"\n'
    (folder / "unit.toml").write_text(text)
    return folder


def zipped(content: bytes, path: Path) -> bytes:
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("rows.csv", content)
    return path.read_bytes()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("rows.csv.gz", PACKED[:-20], "damaged gzip"),
        ("rows.csv.gz", PACKED[:1000] + b"xyz" + PACKED[1003:], "damaged gzip"),
        ("rows.csv.gz", PACKED[:-6] + b"\0" * 6, "damaged gzip"),
        ("rows.csv.gz", CSV, "is no gzip file"),
        ("rows.csv", PACKED, "is packed with gzip"),
        ("rows.zip", CSV, "an archive by its name"),
        ("rows.xz", CSV, "an archive by its name"),
        ("rows.zst", CSV, "an archive by its name"),
        ("rows.tar", CSV, "an archive by its name"),
        ("rows.csv", lzma.compress(CSV), "packed with xz"),
        ("rows.csv", bz2.compress(CSV), "packed with bzip2"),
        ("rows.csv", (ROOT / "data/pictures/hysteresis.png").read_bytes(), "zero bytes"),
        ("rows.csv", CSV.decode().encode("utf-16-le"), "zero bytes"),
        ("rows.csv", CSV.rpartition(b",")[0], "the file ends within a row"),
        ("rows.csv", CSV.replace(b"\n2,", b"\n0,2,"), "5 fields, its header has 4.*\n.* more faults"),
        ("rows.csv", b"", "no table"),
        ("rows.csv", CSV.splitlines()[0] + b"\n", "no row"),
        ("rows.csv", CSV.replace(b"cycle,crank_deg", b"cycle, cycle ", 1), 'more than one column "cycle"'),
    ],
)
def test_a_file_that_is_no_table_is_named(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        read(with_file(tmp_path / "u", name, content))
    assert all(line.startswith(name) for line in error.value.problems)


def test_a_zip_archive_under_the_name_of_a_table_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a ZIP archive; unpack it"):
        read(with_file(tmp_path / "u", "rows.csv", zipped(CSV, tmp_path / "z")))


@pytest.mark.parametrize("separator", ["\\n", "\\r", '\\"', "\\u0000", "a", "1", "-", " ", "\\\\", "|", "é"])
def test_an_odd_separator_is_a_fault_or_an_error_of_its_file(tmp_path: Path, separator: str) -> None:
    folder = write_unit(tmp_path / "u", {}, UNIT + f'[[files]]\npath = "r.csv"\nseparator = "{separator}"\n')
    (folder / "r.csv").write_bytes(CSV)
    try:
        message = [fault.message for fault in read(folder).fatal if fault.kind == "missing column"]
    except InputError as error:
        message = list(error.problems)
    assert message
    assert all("r.csv" in line for line in message)


@pytest.mark.parametrize("column", ["crank_deg", "torque_Nm", "angle_arcmin"])
@pytest.mark.parametrize("value", [1e308, -1e308, 1e13])
def test_values_that_nobody_measured_are_faults_with_their_rows(tmp_path: Path, column: str, value: float) -> None:
    table = measured()
    table[column] = table[column].astype(float)
    table.loc[40, column] = value
    (fault,) = [f for f in read(write_unit(tmp_path / "a", {"r.csv": table})).faults if f.kind == "not a number"]
    assert (fault.rows, fault.severity) == (("r.csv:42",), "note")
    table[column] = value * (1 + 0.1 * np.sin(np.arange(len(table))))
    assert any(f.kind == "not a number" for f in read(write_unit(tmp_path / "b", {"r.csv": table})).fatal)


def test_one_branch_is_a_fault(tmp_path: Path) -> None:
    assert read(write_unit(tmp_path / "u", {"r.csv": ONE_CYCLE[:81]})).fatal


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no table"),
        ("unit,lost_motion_arcmin\n", "no unit; give one row per unit"),
        ("unit,lost_motion_arcmin\na,1e308\n", "must be 0 to 1e\\+12"),
        ("unit,lost_motion_arcmin\na,inf\n", "must be 0"),
        ("unit,lost_motion_arcmin, lost_motion_arcmin\na,1,2\n", 'more than one column "lost_motion_arcmin"'),
        ("unit\0,lost_motion_arcmin\na,1\n", "zero bytes"),
    ],
)
def test_units_that_are_no_population_are_named(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "units.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        load_population(tmp_path / "units.csv")


needs_proc = pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="peak memory is read from /proc")


def measured_memory(folder: Path) -> tuple[str, float, float]:
    """What reading a unit says, and the largest resident memory [MiB] of its process before and after."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-c", MEMORY, str(folder), str(ROOT)]
    process = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    message, memory = process.stdout.strip().rsplit("\n", 1)
    memory_before, memory_after = map(float, memory.split())
    return message, memory_before, memory_after


@needs_proc
@pytest.mark.long
def test_a_gzip_that_unpacks_beyond_the_bound_is_refused_in_constant_memory(tmp_path: Path) -> None:
    """150 kB that unpack to 150 MB, in one line; the bound is an eighth of the program's own, to save time."""
    folder = write_unit(tmp_path / "u", {})
    (folder / "rows.csv.gz").write_bytes(gzip.compress(b"1" * (1 << 24)) * 9)  # a gzip of 9 members
    message, memory_before, memory_after = measured_memory(folder)
    assert "more than 134217728 bytes, unpacked" in message
    assert memory_after - memory_before < 30


@pytest.mark.parametrize(("rows", "limit"), [(300_000, 600), pytest.param(3_000_000, 2048, marks=pytest.mark.attack)])
@pytest.mark.long
def test_many_rows_are_read_and_judged_within_a_stated_memory(tmp_path: Path, rows: int, limit: float) -> None:
    """`limit` in MiB, of the whole process: libraries take some 250 of it."""
    folder = write_unit(tmp_path / "u", {})
    table = measured(positions=(0.0, 90.0), cycles=4, per_branch=rows // 24)
    assert len(table) >= rows
    table.round(6).to_csv(folder / "rows.csv", index=False)
    message, memory_before, memory_after = measured_memory(folder)
    print(f"{len(table)} rows: {memory_before:.0f} MiB before, {memory_after:.0f} MiB at most")
    assert message == f"{len(table)} rows"
    assert memory_after < limit


def test_a_missing_column_is_told_with_the_header_that_was_found(tmp_path: Path) -> None:
    table = measured().drop(columns="torque_Nm").assign(**{f"extra_{k}": 0.0 for k in range(15)})
    folder = write_unit(tmp_path / "u", {"rows.csv": table})
    (message,) = [fault.message for fault in read(folder).fatal if fault.kind == "missing column"]
    assert "has no column 'torque_Nm', its header is: cycle, crank_deg, angle_arcmin, extra_0," in message
    assert "extra_8, ...; name the column of torque_Nm in [columns.torque_Nm]" in message


def test_lines_above_the_header_are_told_in_one_sentence(tmp_path):
    (tmp_path / "bench.csv").write_text("Bench: 7\nOperator: A\ncycle,torque_Nm\n0,1.5\n0,2.5\n0,3.5\n")
    with pytest.raises(InputError) as caught:
        read_table(tmp_path / "bench.csv", "bench.csv")
    (line,) = caught.value.problems
    assert line.startswith("bench.csv: 4 rows have 2 fields, its header 1; is the header below other lines?")
