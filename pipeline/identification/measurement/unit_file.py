"""The file `unit.toml` of a measured unit: what was measured, with which instrument, and how its columns are named."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from pydantic import ValidationError

from pipeline.config import Study, load_design, parse_study
from pipeline.config.designs.design import Design
from pipeline.config.files.key_reference import problems_of
from pipeline.config.files.section import NAME, NAME_RULE, Mistake, nearest_name, shown_value
from pipeline.config.mechanisms.carrier import Carrier
from pipeline.config.reading import found_file, raise_if, read_toml, validate_sections, with_tuples
from pipeline.config.studies.tolerances import Case, case_problems
from pipeline.errors import InputError
from pipeline.identification.measurement.unit_sections import (
    NEITHER,
    UNKNOWN_STATUS,
    DataFile,
    UnitSettings,
    collect,
    crank_of_design_problems,
    crank_problems,
    drive_problems,
    file_problems,
    held_out_problems,
    output_problems,
    table_problems,
    turning_problems,
)

UNIT_FILE = "unit.toml"


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
    problems += drive_problems(raw)
    design = collect(lines, lambda: load_design(_nearby(parts["design"], path.parent), root), bool(parts.get("design")))
    study = collect(
        lines,
        lambda: _study_of(parts["study"], parts["design"], design, path, root),
        design is not None and bool(parts.get("study")),
    )
    as_measured = parts.get("as_measured") or UNKNOWN_STATUS
    dimensions = collect(
        lines, lambda: _dimensions(path.parent, as_measured, file, design), as_measured != UNKNOWN_STATUS
    )
    files = parts.get("files") or tuple(DataFile(path=name) for name in _csv_names(path.parent))
    problems += file_problems(files, path.parent) if "files" in parts or "files" not in raw else []
    problems += held_out_problems(parts)
    problems += turning_problems(parts, design)
    problems += crank_problems(parts)
    problems += crank_of_design_problems(parts, design)
    problems += output_problems(design, parts.get("locked") == NEITHER)
    if problems or lines:
        lines += table_problems(files, path.parent)
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
    units = [collect(lines, partial(load_measured_unit, file, root), True) for file in files]
    if lines:
        raise InputError(lines)
    return [unit for unit in units if unit] or [load_measured_unit(path_or_name, root)]


def _unit_path(typed_path: Path, root: Path) -> Path:
    home = root / "data" / "measured"
    for candidate in (typed_path, root / typed_path, home / typed_path):
        path = candidate if candidate.name == UNIT_FILE else candidate / UNIT_FILE
        if path.is_file():
            return path.parent.resolve() / UNIT_FILE  # not of the folder that a linked unit.toml is in
    names = [path.parent.name for path in home.glob(f"*/{UNIT_FILE}")]
    advice = nearest_name(typed_path.name, names) if names else "data/measured has none"
    raise InputError(f"unit = {str(typed_path)!r}; no such folder with a {UNIT_FILE}; {advice}")


def _nearby(name: str, folder: Path) -> str | Path:
    """The file of a path relative to `folder`, if it is there; else `name`, a stem or a path of the project."""
    return folder / name if Path(name).suffix == ".toml" and (folder / name).is_file() else name


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
