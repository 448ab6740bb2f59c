"""Design and study files read from TOML; all problems of all files are reported together."""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import BaseModel, TypeAdapter, ValidationError

from pipeline.config.designs.design import Design
from pipeline.config.designs.flank import with_flank_file
from pipeline.config.designs.problems import effect_problems, geometry_problems
from pipeline.config.drawn_temperature import (
    draw_problems,
    draw_sentence,
    growth_tolerances,
    plain_temperatures,
    read_draws,
    thermal_of,
)
from pipeline.config.files.key_reference import problems_of
from pipeline.config.files.section import MISSING, NAME, NAME_RULE, Mistake, nearest_name, shown_value
from pipeline.config.files.table_file import READ
from pipeline.config.stated_temperature import (
    Temperature,
    temperature_problems,
    temperature_sentence,
    thermal_growth,
    warm_case,
    warm_design,
    warm_tolerances,
)
from pipeline.config.studies.consistency import provenance_problems, study_problems, with_turn
from pipeline.config.studies.costs import Costs, cost_problems
from pipeline.config.studies.optional import ANY_MESH, with_mesh
from pipeline.config.studies.study import Study
from pipeline.config.studies.tolerances import Case, GaugedCase, Tolerances, case_problems, tolerance_problems
from pipeline.config.tolerance_notation import reading_mistakes, with_notation
from pipeline.errors import InputError

BUNDLED_DATA = Path(__file__).parent.parent / "bundled"
"""Designs and studies of an installed package; a checkout has them in data."""
LARGEST_FILE = 1 << 24
"""Bytes of a settings file: measured deviations of a thousand units with a hundred pins fit three times."""
CRANK_TURNS = 'unknown key; it follows from turn = "output" or "crank" and the design'
"""Said of the turns of the crank in a file."""
DEEPEST_TABLE = 20
"""Tables within tables that are read; settings need three."""


def load_design(path_or_stem: str | Path, root: Path) -> Design:
    """The design of a TOML file.

    Parameters
    ----------
    path_or_stem : a path, or the stem of a file in data/designs.
    root : the project's folder.

    Raises
    ------
    InputError : the file is missing, is no TOML, or holds values that are not allowed; with all of its problems.
    """
    path = found_file(path_or_stem, root, "designs", [Path(), root])
    return parse_design(_design_tables(path), file_label(path))


def load_study(path_or_stem: str | Path, root: Path) -> Study:
    """The study of a TOML file, with its design; its name is the file's stem.

    Parameters
    ----------
    path_or_stem : a path, or the stem of a file in data/studies.
    root : the project's folder.

    Raises
    ------
    InputError : a file is missing, is no TOML, or holds values that are not allowed; with all problems of both files.
        Or another file of that name in data/studies has the same folder of runs.
    """
    path = found_file(path_or_stem, root, "studies", [Path(), root])
    namesake = root / "data/studies" / path.name
    if namesake.is_file() and namesake.read_bytes() != path.read_bytes():
        raise InputError(f"{path}: its runs would replace those of data/studies/{namesake.name}; rename the file")
    return parse_study(read_toml(path), path.stem, file_label(path), lambda name: _study_design(name, path, root))


def load_case(path: Path, study: Study) -> GaugedCase:
    """The measured dimensions of one unit of a study's design, by the file's stem.

    Raises
    ------
    InputError : the file is missing, is no TOML, or holds values that are not allowed.
    """
    if not path.is_file():
        raise InputError([f"dimensions = {shown_value(str(path))}; no such file; give the path of a TOML file"])
    raw = with_tuples({"label": path.stem, **read_toml(path)})
    problems, _ = validate_sections(GaugedCase, raw)
    if not problems:
        case = GaugedCase(**raw)
        problems = [
            replace(problem, key=problem.key.removeprefix("cases[0]."))
            for problem in case_problems({0: case}, study.design)
        ]
    raise_if(problems, file_label(path))
    return case


def load_unit(path: Path, design: str, study: str | Path, root: Path) -> Study:
    """A study of one unit: its measured errors, and the mesh, cycle and metrics of an ordinary study.

    Parameters
    ----------
    path : TOML file of measured errors [um], as in one entry of a study's cases; the label is the file's stem.
    design : a path, or the stem of a file in data/designs.
    study : the ordinary study; its samples, tolerances and design are not used.
    root : the project's folder.

    Raises
    ------
    InputError : a file is missing, is no TOML, or holds values that are not allowed.
    """
    if not path.is_file():
        raise InputError([f"dimensions = {shown_value(str(path))}; no such file; give the path of a TOML file"])
    nominal = load_design(design, root)
    ordinary = read_toml(found_file(study, root, "studies", [Path(), root]))
    settings: dict[str, Any] = {
        **{name: value for name, value in ordinary.items() if name not in ("tolerances", "cases")},
        "title": f"{nominal.title}: unit {path.stem}",
        "description": "",
        "design": design,
        "samples": {"count": 1, "experiment": "cases", "nominal_first": True},
        "cases": [{"label": path.stem, **read_toml(path)}],
    }
    if isinstance(ordinary.get("cycle", {}), dict):
        settings["cycle"] = {**ordinary.get("cycle", {}), "keep_contacts": "all"}
    return parse_study(settings, f"unit-{path.stem}", file_label(path), lambda _: nominal)


def parse_design(data: Mapping[str, Any], file: str) -> Design:
    """The design in the parsed TOML `data`; `file` names it in messages.

    Raises
    ------
    InputError : with every problem found.
    """
    raw = with_tuples(data)
    problems, parts = validate_sections(Design, raw)
    if raw.get("thermal") is not None:
        problems.append(Mistake("thermal", None, "unknown key; temperatures are of a study: [temperature]"))
    problems += geometry_problems(parts)
    problems += effect_problems(parts.get("effects", {}))
    problems += provenance_problems(parts, raw)
    raise_if(problems, file)
    return Design.model_validate(raw)


def parse_study(data: Mapping[str, Any], name: str, file: str, read_design: Callable[[str], Design]) -> Study:
    """The study in the parsed TOML `data`.

    Parameters
    ----------
    data : the file's content; `design` is the name that `read_design` resolves.
    name : of the study, its run folder.
    file : names the study file in messages.
    read_design : the design of a name; may raise InputError, whose problems join the study's own.

    Raises
    ------
    InputError : with every problem found in both files.
    """
    raw = with_tuples(data)
    design, design_problems = _referenced_design(raw.get("design"), read_design)
    unreadable: list[Mistake] = []
    if "tolerances" in raw:
        without_reading = reading_mistakes(raw["tolerances"], raw.get("clearance"))
        raw["tolerances"], unreadable = with_notation(raw["tolerances"], design)
        unreadable += without_reading
    raw, design, mistakes = _at_temperature(raw, design)
    unreadable += mistakes
    cases = raw.get("cases", ()) if isinstance(raw.get("cases", ()), tuple) else ()
    if isinstance(raw.get("samples"), dict) and raw["samples"].get("experiment") == "cases":
        raw["samples"].setdefault("count", max(1, len(cases)))
    if design is not None and isinstance(raw.get("cycle"), dict):
        if "crank_turns" in raw["cycle"]:
            unreadable.append(Mistake("cycle.crank_turns", raw["cycle"]["crank_turns"], CRANK_TURNS))
        raw["cycle"] = with_turn(raw["cycle"], design)
    if isinstance(raw.get("reduce", {}), dict):
        raw["reduce"] = with_mesh(raw.get("reduce", {}), design) if design else {**ANY_MESH, **raw.get("reduce", {})}
    problems, parts = validate_sections(Study, {**raw, "name": name, "design": design})
    problems = unreadable + [problem for problem in problems if problem.key != "design"]
    problems += study_problems(parts, raw)
    if "design" not in raw or not (design or design_problems):
        problems.append(Mistake("design", raw.get("design", MISSING), "must be the name of a design file"))
    if "name" in raw:
        problems.append(Mistake("name", raw["name"], "unknown key; a study has the name of its file"))
    problems += tolerance_problems(_valid_fields(Tolerances, raw.get("tolerances", {})), design)
    problems += cost_problems(_valid_fields(Costs, raw.get("costs", {})))
    problems += case_problems(_valid_cases(cases), design)
    raise_if(problems, file, design_problems)
    return Study.model_validate({**raw, "name": name, "design": design})


def _at_temperature(raw: dict[str, Any], design: Design | None) -> tuple[dict[str, Any], Design | None, list[Mistake]]:
    """The study and its design at the temperatures that it states or draws, if any; without the section."""
    if "temperature" not in raw:
        return raw, design, []
    remaining = {name: value for name, value in raw.items() if name != "temperature"}
    section = raw["temperature"] if isinstance(raw["temperature"], Mapping) else {}
    temperatures, draw_sections, follows, problems = plain_temperatures(section)
    draws, mistakes = read_draws(draw_sections)
    problems += mistakes
    if problems:
        return remaining, design, problems
    try:
        temperature = Temperature.model_validate(temperatures)
    except ValidationError as error:
        mistakes = problems_of(error, Temperature)
        return remaining, design, [Mistake(f"temperature.{p.key}", p.value, p.requirement) for p in mistakes]
    if design is None:
        return remaining, design, []
    if mistakes := temperature_problems(temperature, design):
        return remaining, design, mistakes
    warm = thermal_growth(temperature, design)
    thermal = thermal_of(warm, design, draws, follows)
    if mistakes := draw_problems(temperature, thermal, design, draws):
        return remaining, design, mistakes
    raw_cases, tolerances = remaining.get("cases"), remaining.get("tolerances", {})
    if isinstance(raw_cases, tuple) and raw_cases:
        if draws:
            requirement = "is a distribution, and the study lists its units; state one number"
            return remaining, design, [Mistake(f"temperature.{part}_C", None, requirement) for part in draws]
        cases = (warm_case(warm, case, design) if isinstance(case, Mapping) else case for case in raw_cases)
        remaining["cases"] = tuple(cases)
    elif isinstance(tolerances, Mapping):
        remaining["tolerances"] = warm_tolerances(warm, tolerances, design) | growth_tolerances(thermal, draws)
    of_draws = draw_sentence(draws, follows) if draws else ""
    sentences = (remaining.get("description", ""), temperature_sentence(temperature), of_draws)
    remaining["description"] = " ".join(filter(None, map(str, sentences)))
    return remaining, warm_design(warm, design).model_copy(update={"thermal": thermal if draws else None}), []


def _referenced_design(name: object, read_design: Callable[[str], Design]) -> tuple[Design | None, Sequence[str]]:
    """The design that a study names, or the problems of its file."""
    try:
        return (read_design(name), ()) if isinstance(name, str) else (None, ())
    except InputError as error:
        return None, error.problems


def validate_sections(model: type[BaseModel], raw: Mapping[str, Any]) -> tuple[list[Mistake], dict[str, Any]]:
    """The problems of `raw` as pydantic finds them, and the sections that are valid by themselves."""
    try:
        instance = model.model_validate(raw)
    except ValidationError as error:
        return problems_of(error, model), _valid_fields(model, raw)
    return [], {name: getattr(instance, name) for name in model.model_fields}


def _valid_fields(model: type[BaseModel], raw: object) -> dict[str, Any]:
    if not isinstance(raw, dict):
        return {}
    valid = {}
    for name, field in model.model_fields.items():
        if name not in raw:
            continue
        try:
            valid[name] = TypeAdapter(field.rebuild_annotation()).validate_python(raw[name], strict=True)
        except ValidationError:
            continue
    return valid


def _valid_cases(raw: tuple[object, ...]) -> dict[int, Case]:
    valid = {}
    for position, case in enumerate(raw):
        try:
            valid[position] = Case.model_validate(case)
        except ValidationError:
            continue
    return valid


def with_tuples(value: Any) -> Any:
    """`value` with lists as tuples, which strict validation asks of frozen sections."""
    if isinstance(value, Mapping):
        return {key: with_tuples(item) for key, item in value.items()}
    return tuple(map(with_tuples, value)) if isinstance(value, list | tuple) else value


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file; InputError if it is none, or larger or deeper than settings are."""
    READ.add(path)
    size = path.stat().st_size
    if size > LARGEST_FILE:
        requirement = f"settings have at most {LARGEST_FILE}; is it another file?"
        raise InputError([f"{file_label(path)}: has {size} bytes, {requirement}"])
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except RecursionError:
        problem = f"{file_label(path)}: not a settings file: lists or tables nested too deeply; flatten it"
        raise InputError([problem]) from None
    except ValueError as error:  # no TOML, no text, or a number of thousands of digits
        raise InputError([f"{file_label(path)}: not a TOML file: {error}; correct the line"]) from None
    if _depth(tables) > DEEPEST_TABLE:
        problem = f"{file_label(path)}: tables nested deeper than {DEEPEST_TABLE}; settings are not; correct a key"
        raise InputError([problem])
    return tables


def _depth(value: Any) -> int:
    """How deep tables and lists are nested; counted level by level, since Python's own stack is not deep."""
    depth, level = 0, [value]
    while level:
        depth += 1
        level = [
            item
            for outer in level
            for item in (outer.values() if isinstance(outer, dict) else outer)
            if isinstance(item, dict | list)
        ]
    return depth


def _study_design(name: str, study: Path, root: Path) -> Design:
    path = found_file(name, root, "designs", [study.parent, root], f"{file_label(study)}: design")
    return parse_design(_design_tables(path), file_label(path))


def file_label(path: Path) -> str:
    """A file in messages, with its folder: a study and its design may have one name."""
    return f"{path.resolve().parent.name}/{path.name}"


def _design_tables(path: Path) -> dict[str, Any]:
    """The tables of a design file, with the flank file that it names."""
    try:
        return with_flank_file(read_toml(path), path.parent)
    except InputError as error:
        raise InputError(
            [line if line.startswith(file_label(path)) else f"{file_label(path)}: {line}" for line in error.problems]
        ) from None


def found_file(name: str | Path, root: Path, kind: str, bases: list[Path], key: str = "") -> Path:
    """The file of a path (under one of `bases`) or of a stem (under data/`kind`).

    Raises
    ------
    InputError : the name is none that a file here may have, or there is no such file.
    """
    home = root / "data" / kind
    if not NAME.fullmatch(Path(name).stem):
        raise InputError([f"{key or kind} = {shown_value(str(name))}; the file's name {NAME_RULE}"])
    homes = [home, BUNDLED_DATA / kind]
    places = [base / name for base in bases] if Path(name).suffix == ".toml" else [h / f"{name}.toml" for h in homes]
    for candidate in places:
        if candidate.is_file():
            return candidate
    stems = [path.stem for folder in homes for path in folder.glob("*.toml")]
    advice = nearest_name(Path(name).stem, stems) if stems else f"data/{kind} is empty"
    raise InputError([f"{key or kind} = {str(name)!r}; no such file; {advice}"])


def raise_if(problems: list[Mistake], file: str, other_files: Sequence[str] = ()) -> None:
    """Raise InputError with the `problems` of `file` and the lines of `other_files`, if there are any."""
    lines = [problem.line(file) for problem in problems] + list(other_files)
    if lines:
        raise InputError(lines)
