"""The file `unit.toml` of a measured unit: what was measured, with which instrument, and how its columns are named."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field, ValidationError

from pipeline.config import Study, load_design, parse_study
from pipeline.config.designs.design import Design
from pipeline.config.files.messages import problems_of
from pipeline.config.files.section import (
    MISSING,
    NAME,
    NAME_RULE,
    Mistake,
    Positive,
    Section,
    nearest_name,
    shown_value,
)
from pipeline.config.files.table_file import read_table
from pipeline.config.mechanisms.carrier import Carrier
from pipeline.config.reading import found_file, raise_if, read_toml, validate_sections, with_tuples
from pipeline.config.studies.cases import Case, case_problems
from pipeline.errors import InputError
from pipeline.identification.measurement.columns import Columns, Text

T = TypeVar("T")
UNIT_FILE = "unit.toml"
UNKNOWN_STATUS = "unknown"
NEITHER = "neither"
"""Of the ends, locked: the crank turns."""


class DataFile(Section):
    """A CSV file (gzip allowed), the constants for columns it lacks, and which of its rows count.

    `position` names the place where the drive was locked: equal names in several states of a drive are one position,
    also where the crank angles at their first rows differ.
    `where` gives the allowed values of raw columns: test_nr = [100, 101]. Without a separator it and the decimal mark
    are read off the file's first lines.
    """

    path: Text
    position: Text | None = None
    crank_deg: float | None = None
    cycle: int | None = None
    where: dict[str, Annotated[tuple[int | float | str, ...], Field(min_length=1)]] = {}
    separator: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    decimal: Literal[".", ","] = "."


class InstrumentSection(Section):
    """What is known of the bench; nothing need be."""

    angle_resolution_arcmin: Positive | None = None
    angle_noise_arcmin: Positive | None = None
    torque_resolution_Nm: Positive | None = None
    torque_noise_Nm: Positive | None = None
    torque_saturation_Nm: Positive | None = None


class Environment(Section):
    """State of the unit; the dimensions hold at `temperature_C`."""

    temperature_C: Annotated[float, Field(gt=-273.15)] = 20.0
    lubricant: str = ""


class StateSection(Section):
    """The state of a drive among others: the assembly that it was measured in, and numbers that order the states.

    Within one ``assembly`` positions keep their pattern. ``values`` are numbers such as the turns of a preload screw.
    """

    assembly: str = ""
    values: dict[Text, float] = {}


class HeldOut(Section):
    """Which data judge the model: whole crank positions if there are two, else whole cycles; never single rows.

    `train` lists the crank angles [deg] or cycles to fit; by default every second one, from the first. Of a turning
    drive whole cycles, held torques [N m], senses of the crank (1, -1) or temperatures, each in turn by default.
    """

    by: Literal["position", "cycle", "torque", "sense", "temperature"] | None = None
    train: tuple[float, ...] = ()


class Generic(Section):
    """A drive of which no design is known: input turns per turn of the output, and the torque that it is rated for.

    `crank_turns` are those of the crank against the output per turn of it, of a drive with gears before the crank.
    """

    ratio: Annotated[float, Field(ge=1)]
    rated_torque_Nm: Positive
    crank_turns: Annotated[float, Field(ge=1)] | None = None


class CrankSection(Section):
    """How the crank moves within a record, and where the torque was measured.

    It is "fixed" where the input is locked. Where the output is locked and the motor's side is read, it
    "follows_angle": it turns by -`ratio` times the angle that is read. Or it turns by a `column` [deg] of the files.
    In both cases `crank_deg` is the crank angle at the first row of each position, counted over a turn of the output.

    `ratio` has a sign: turns of the crank per turn of the output, negative with the housing held. A torque at the
    "input" is that of the motor times the ratio. `twist_before_disk` is the share of the twist that lies between crank
    and disk, by which the disk does not turn against the housing.
    """

    moves: Literal["fixed", "follows_angle", "column"] = "fixed"
    ratio: float | None = None
    column: Text | None = None
    torque_at: Literal["output", "input"] = "output"
    twist_before_disk: Annotated[float, Field(ge=0, le=1)] = 0.0


class UnitSettings(Section):
    """A file unit.toml: of a drive with a design, its study and dimensions, or of a ``generic`` one.

    `crank_angles` says whether `crank_deg` was measured from the drawing's zero; of "unknown" ones it tells positions
    apart and no more, and without any each file is a position. Torque and angle are of one `side`; those of the input
    are taken to the output by the ratio; a record's torque is then the mean of both senses. With neither end `locked`
    the crank turns while a torque is held, and `angle` says whether the column is the error of the output against the
    ideal ratio, or the angle of the output itself.
    """

    title: Text
    source: str = ""
    design: Text | None = None
    study: Text | None = None
    generic: Generic | None = None
    locked: Literal["input", "output", "neither"]
    offset: Literal["per_position", "common"]
    side: Literal["output", "input"] = "output"
    angle: Literal["error", "absolute"] = "error"
    crank_angles: Literal["measured", "unknown"] = "measured"
    crank: CrankSection = CrankSection()
    as_measured: Text | None = None
    instrument: InstrumentSection = InstrumentSection()
    environment: Environment = Environment()
    state: StateSection = StateSection()
    held_out: HeldOut = HeldOut()
    files: tuple[DataFile, ...] = ()
    columns: Columns = Columns()


@dataclass(frozen=True)
class UnitFile:
    """A measured unit, read and checked; its data are still on disk.

    Attributes
    ----------
    name : of the folder.
    folder : where unit.toml stands.
    settings : what unit.toml says.
    design_study : the study that it names, with the unit's design: tolerances (the prior), mesh, laws, metrics; None of
        a generic drive.
    dimensions : as-measured deviations [um]; None where unknown.
    files : the data files in the order of reading; `path` of each is relative to `folder`.
    """

    name: str
    folder: Path
    settings: UnitSettings
    design_study: Study | None
    dimensions: Case | None
    files: tuple[DataFile, ...]

    @property
    def study(self) -> Study:
        """The study of a unit that has a design.

        Raises
        ------
        InputError : the drive is generic.
        """
        if self.design_study is None:
            raise InputError(f"{self.name}/unit.toml: a generic drive has no design; name one, and its study")
        return self.design_study

    @property
    def input_ratio(self) -> float:
        """Input turns per turn of the output where the files hold torque and angle of the input, else 1."""
        if self.settings.side == "output":
            return 1.0
        if self.settings.generic:
            return self.settings.generic.ratio
        design = self.study.design
        return (
            design.output.ratio(design.cycloid) if isinstance(design.output, Carrier) else float(design.cycloid.ratio)
        )

    @property
    def is_record(self) -> bool:
        """Whether the drive turned and is described by its own record: without a design, or as a carrier."""
        if self.settings.locked != NEITHER:
            return False
        return self.design_study is None or self.design_study.design.output.carries_disks

    @property
    def has_anonymous_positions(self) -> bool:
        """Whether unit.toml gives no crank angle and need not: without a column of it each file is a position."""
        settings = self.settings
        if "crank_deg" in settings.columns.model_fields_set or any(file.crank_deg is not None for file in self.files):
            return False
        return settings.locked != NEITHER and (settings.generic is not None or settings.crank_angles == UNKNOWN_STATUS)

    @property
    def rated_torque_Nm(self) -> float:
        """Torque that the drive is rated for."""
        generic = self.settings.generic
        return generic.rated_torque_Nm if generic else self.study.design.cycloid.rated_torque_Nm


def load_measured_unit(path_or_name: str | Path, root: Path) -> UnitFile:
    """The measured unit of a folder.

    Parameters
    ----------
    path_or_name : a folder, its unit.toml, or the name of a folder in data/measured.
    root : the project's folder.

    Raises
    ------
    InputError : a file is missing or holds values that are not allowed; with all problems of unit.toml, of the design,
        of the study and of the as-measured dimensions.
    """
    path = _unit_path(Path(path_or_name), root)
    file = f"{path.parent.name}/{path.name}"
    raw = with_tuples(read_toml(path))
    if not NAME.fullmatch(path.parent.name):
        raise InputError(f"unit = {shown_value(path.parent.name)}; the folder's name {NAME_RULE}")
    problems, parts = validate_sections(UnitSettings, raw)
    lines: list[str] = []
    problems += _drive_problems(raw)
    design = _collect(
        lines, lambda: load_design(_nearby(parts["design"], path.parent), root), bool(parts.get("design"))
    )
    study = _collect(
        lines,
        lambda: _study_of(parts["study"], parts["design"], design, path, root),
        design is not None and bool(parts.get("study")),
    )
    as_measured = parts.get("as_measured") or UNKNOWN_STATUS
    dimensions = _collect(
        lines, lambda: _dimensions(path.parent, as_measured, file, design), as_measured != UNKNOWN_STATUS
    )
    files = parts.get("files") or tuple(DataFile(path=name) for name in _csv_names(path.parent))
    problems += _file_problems(files, path.parent) if "files" in parts or "files" not in raw else []
    problems += _held_out_problems(parts)
    problems += _turning_problems(parts, design)
    problems += _crank_problems(parts)
    problems += _crank_of_design_problems(parts, design)
    problems += _output_problems(design, parts.get("locked") == NEITHER)
    if problems or lines:
        lines += _table_problems(files, path.parent)
    raise_if(problems, file, lines)
    return UnitFile(path.parent.name, path.parent, UnitSettings.model_validate(raw), study, dimensions, files)


def load_measured_units(path_or_name: str | Path, root: Path) -> list[UnitFile]:
    """The units of a folder: that of its unit.toml, else those of all folders in it that have one, by name.

    Raises
    ------
    InputError : as ``load_measured_unit``, with the problems of all units.
    """
    folders = [folder for folder in (Path(path_or_name), root / path_or_name) if folder.is_dir()]
    files = sorted(folders[0].glob(f"*/{UNIT_FILE}")) if folders and not (folders[0] / UNIT_FILE).is_file() else []
    lines: list[str] = []
    units = [_collect(lines, partial(load_measured_unit, file, root), True) for file in files]
    if lines:
        raise InputError(lines)
    return [unit for unit in units if unit] or [load_measured_unit(path_or_name, root)]


def _unit_path(typed_path: Path, root: Path) -> Path:
    home = root / "data" / "measured"
    for candidate in (typed_path, root / typed_path, home / typed_path):
        path = candidate if candidate.name == UNIT_FILE else candidate / UNIT_FILE
        if path.is_file():
            return path.resolve()
    names = [path.parent.name for path in home.glob(f"*/{UNIT_FILE}")]
    advice = nearest_name(typed_path.name, names) if names else "data/measured has none"
    raise InputError(f"unit = {str(typed_path)!r}; no such folder with a {UNIT_FILE}; {advice}")


def _nearby(name: str, folder: Path) -> str | Path:
    """The file of a path relative to `folder`, if it is there; else `name`, a stem or a path of the project."""
    return folder / name if Path(name).suffix == ".toml" and (folder / name).is_file() else name


def _collect(lines: list[str], read: Callable[[], T], is_required: bool) -> T | None:
    """What `read` returns; None if it is not wanted, or raises InputError, whose problems are added to `lines`."""
    try:
        return read() if is_required else None
    except InputError as error:
        lines += error.problems
        return None


def _study_of(study: str, design_name: str, design: Design | None, unit: Path, root: Path) -> Study:
    assert design is not None
    path = found_file(study, root, "studies", [unit.parent, root])
    settings = {**read_toml(path), "design": design_name}
    return parse_study(settings, f"unit-{unit.parent.name}", path.name, lambda _: design)


def _dimensions(folder: Path, name: str, file: str, design: Design | None) -> Case:
    path = folder / name
    if not path.is_file():
        raise InputError(
            f'{file}: as_measured = "{name}"; no such file in the unit\'s folder; or say "{UNKNOWN_STATUS}"'
        )
    raw = {"label": path.stem, **with_tuples(read_toml(path))}
    try:
        case = Case.model_validate(raw)
    except ValidationError as error:
        raise_if(problems_of(error, Case), path.name)
        raise
    problems = case_problems({0: case}, design)
    raise_if([Mistake(p.key.removeprefix("cases[0]."), p.value, p.requirement) for p in problems], path.name)
    return case


def _csv_names(folder: Path) -> list[str]:
    return sorted(path.name for pattern in ("*.csv", "*.csv.gz") for path in folder.glob(pattern))


def _file_problems(files: tuple[DataFile, ...], folder: Path) -> list[Mistake]:
    if not files:
        return [Mistake("files", None, "no data: put CSV files into the unit's folder, or list them as [[files]]")]
    problems = []
    for number, file in enumerate(files):
        if not (folder / file.path).is_file():
            problems.append(
                Mistake(f"files[{number}].path", file.path, "no such file; a path is relative to unit.toml")
            )
        if file.separator == file.decimal:
            problems.append(Mistake(f"files[{number}].decimal", file.decimal, "must differ from the separator"))
    return problems


def _table_problems(files: tuple[DataFile, ...], folder: Path) -> list[str]:
    """Why data files are no tables; for the one answer that has all problems of a unit."""
    lines: list[str] = []
    for file in files:
        path = folder / file.path
        _collect(lines, partial(read_table, path, file.path, file.separator, file.decimal), path.is_file())
    return lines


def _drive_problems(raw: Mapping[str, Any]) -> list[Mistake]:
    """A drive has a design with all that belongs to it, or is generic."""
    keys = ("design", "study", "as_measured")
    if "generic" in raw:
        return [
            Mistake(key, raw[key], "a drive with [generic] has none; leave out one of both")
            for key in keys
            if key in raw
        ]
    advice = "add it, or [generic] with ratio and rated_torque_Nm for a drive without a design"
    return [Mistake(key, MISSING, advice) for key in keys if key not in raw]


def _output_problems(design: Design | None, turns: bool) -> list[Mistake]:
    if design is None or (turns and design.output.carries_disks):
        return []
    if design.output.carries_disks:
        requirement = (
            f"loops of a {design.output.name} are not identified: its disk has no bearing of its own to separate the "
            'play by; give a record of both encoders with locked = "neither"'
        )
        return [Mistake("design", None, requirement)]
    if design.cycloid.fixed == "housing":
        return []
    requirement = 'its cycloid.fixed must be "housing": measured angles are read at the flange against the housing'
    return [Mistake("design", None, requirement)]


def _turning_problems(parts: Mapping[str, Any], design: Design | None) -> list[Mistake]:
    """A record of a turning drive has one zero; other units are held out by position or cycle."""
    record = bool(parts.get("generic")) or (design is not None and design.output.carries_disks)
    held_out_by, turns = parts.get("held_out", HeldOut()).by, parts.get("locked") == NEITHER
    side, locked_end = parts.get("side", "output"), parts.get("locked")
    refusals: tuple[tuple[bool, str, Any, str], ...]
    if not turns:
        refusals = (
            (
                side == "input" == locked_end,
                "side",
                side,
                'must be "output" where the input is locked: only that moves',
            ),
            (
                held_out_by in ("torque", "sense", "temperature"),
                "held_out.by",
                held_out_by,
                'must be "position" or "cycle"',
            ),
            (parts.get("angle") == "absolute", "angle", "absolute", 'asks for locked = "neither"'),
        )
    else:
        offset, crank_angles = parts.get("offset", "common"), parts.get("crank_angles", "measured")
        refusals = (
            (
                held_out_by == "position",
                "held_out.by",
                held_out_by,
                'must be "cycle", "torque" or "sense" where the crank turns',
            ),
            (
                held_out_by == "temperature" and not record,
                "held_out.by",
                held_out_by,
                'must be "cycle", "torque" or "sense" of a design',
            ),
            (
                held_out_by == "cycle" and record,
                "held_out.by",
                held_out_by,
                'must be "torque", "sense" or "temperature" of a record',
            ),
            (offset != "common", "offset", offset, 'must be "common" where the crank turns: all rows have one zero'),
            (
                crank_angles != "measured",
                "crank_angles",
                crank_angles,
                "a crank that turns is read from the drawing's zero",
            ),
            (side == "input" and not record, "side", side, 'must be "output" where the crank of a design turns'),
        )
    return [Mistake(key, value, requirement) for is_wrong, key, value, requirement in refusals if is_wrong]


def _crank_problems(parts: Mapping[str, Any]) -> list[Mistake]:
    """A crank that moves has a signed ratio; it follows the angle at the motor's side of a locked output alone."""
    crank = parts.get("crank", CrankSection())
    moves = crank.moves != "fixed"
    refusals: tuple[tuple[bool, str, Any, str], ...] = (
        (
            moves and not crank.ratio,
            "crank.ratio",
            crank.ratio,
            "where the crank moves, a number such as -13",
        ),
        (
            crank.moves == "follows_angle" and parts.get("locked") != "output",
            "crank.moves",
            crank.moves,
            'asks for locked = "output": the crank follows the angle of the motor\'s side',
        ),
        (
            (crank.moves == "column") != (crank.column is not None),
            "crank.column",
            crank.column,
            'name it with moves = "column", and only then',
        ),
    )
    return [Mistake(key, value, requirement) for is_wrong, key, value, requirement in refusals if is_wrong]


def _crank_of_design_problems(parts: Mapping[str, Any], design: Design | None) -> list[Mistake]:
    """The crank of a design turns by its own ratio, and in loops against a locked output alone."""
    crank = parts.get("crank", CrankSection())
    if design is None or crank.moves == "fixed":
        return []
    lobes = float(design.cycloid.lobes)
    problems = []
    if crank.ratio and crank.ratio != -lobes:
        problems.append(Mistake("crank.ratio", crank.ratio, f"the design has {lobes:g} lobes; give {-lobes:g}"))
    if parts.get("locked") != "output":
        problems.append(Mistake("crank.moves", crank.moves, 'with a design it asks for locked = "output"'))
    return problems


def _held_out_problems(parts: Mapping[str, Any]) -> list[Mistake]:
    held_out = parts.get("held_out", HeldOut())
    if held_out.train and held_out.by is None:
        return [Mistake("held_out.by", None, 'must be "position" or "cycle" where train is listed')]
    if len(set(held_out.train)) < len(held_out.train):
        return [Mistake("held_out.train", held_out.train, "values must differ")]
    return []
