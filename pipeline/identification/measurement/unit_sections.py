"""Sections of a unit.toml, and contradictions between values that are each allowed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field

from pipeline.config.designs.design import Design
from pipeline.config.files.section import MISSING, Mistake, Positive, Section
from pipeline.config.files.table_file import read_table
from pipeline.errors import InputError
from pipeline.identification.measurement.columns import Columns, Text

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
    torque_Nm: float | None = None
    temperature_C: float | None = None
    input_rpm: float | None = None
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
    "input" is that of the motor times minus the ratio, so that it has the sign of the motor with the housing held.
    `twist_before_disk` is the share of the twist that lies between crank and disk, by which the disk does not turn
    against the housing.
    """

    moves: Literal["fixed", "follows_angle", "column"] = "fixed"
    ratio: float | None = None
    column: Text | None = None
    torque_at: Literal["output", "input"] = "output"
    twist_before_disk: Annotated[float, Field(ge=0, le=1)] = 0.0


class UnitSettings(Section):
    """A file unit.toml: of a drive with a design, its study and dimensions, or of a ``generic`` one.

    `crank_angles` says whether `crank_deg` was measured from the drawing's zero; of "unknown" ones it tells positions
    apart and no more, and without any each file is a position. Dimensions `as_measured` have the standard uncertainty
    `measured_to_um`: once for the error that all elements share, and once for that of each alone. Torque and angle are
    of one `side`; those of the input are taken to the output by the ratio; a record's torque is then the mean of both
    senses.
    `torque_sign` is "against_motion" where a brake loads a record, whose display has no sign. With neither end `locked`
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
    torque_sign: Literal["signed", "against_motion"] = "signed"
    angle: Literal["error", "absolute"] = "error"
    crank_angles: Literal["measured", "unknown"] = "measured"
    crank: CrankSection = CrankSection()
    as_measured: Text | None = None
    measured_to_um: Annotated[float, Field(ge=0)] = 0.3
    instrument: InstrumentSection = InstrumentSection()
    environment: Environment = Environment()
    state: StateSection = StateSection()
    held_out: HeldOut = HeldOut()
    files: tuple[DataFile, ...] = ()
    columns: Columns = Columns()


T = TypeVar("T")


def collect(lines: list[str], read: Callable[[], T], is_required: bool) -> T | None:
    """What `read` returns; None if it is not wanted, or raises InputError, whose problems are added to `lines`."""
    try:
        return read() if is_required else None
    except InputError as error:
        lines += error.problems
        return None


def file_problems(files: tuple[DataFile, ...], folder: Path) -> list[Mistake]:
    """No data, files that are missing, and separators that cannot be told from the decimal mark."""
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


def table_problems(files: tuple[DataFile, ...], folder: Path) -> list[str]:
    """Why data files are no tables; for the one answer that has all problems of a unit."""
    lines: list[str] = []
    for file in files:
        path = folder / file.path
        collect(lines, partial(read_table, path, file.path, file.separator, file.decimal), path.is_file())
    return lines


def drive_problems(raw: Mapping[str, Any]) -> list[Mistake]:
    """A drive has a design with all that belongs to it, or is generic."""
    keys, of_dimensions = ("design", "study", "as_measured"), "measured_to_um"
    if "generic" in raw:
        return [
            Mistake(key, raw[key], "a drive with [generic] has none; leave out one of both")
            for key in (*keys, of_dimensions)
            if key in raw
        ]
    if raw.get("as_measured") == UNKNOWN_STATUS and of_dimensions in raw:
        return [Mistake(of_dimensions, raw[of_dimensions], "requires as_measured, the file of what was measured")]
    advice = "add it, or [generic] with ratio and rated_torque_Nm for a drive without a design"
    return [Mistake(key, MISSING, advice) for key in keys if key not in raw]


def output_problems(design: Design | None, turns: bool) -> list[Mistake]:
    """Outputs of the design whose angle a bench does not read as the model has it."""
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


HELD_OUT_OF: Mapping[str, tuple[tuple[str, ...], str]] = {
    "loops": (("position", "cycle"), 'must be "position" or "cycle"'),
    "record": (("torque", "sense", "temperature"), 'must be "torque", "sense" or "temperature" of a record'),
    "turns of a design": (("cycle", "torque", "sense"), 'must be "cycle", "torque" or "sense" of a design that turns'),
}
"""What may be left out at once, and the same in words, by what was measured."""


def turning_problems(parts: Mapping[str, Any], design: Design | None) -> list[Mistake]:
    """A record of a turning drive has one zero; other units are held out by position or cycle."""
    record = bool(parts.get("generic")) or (design is not None and design.output.carries_disks)
    side, locked_end = parts.get("side", "output"), parts.get("locked")
    held_out_by = parts.get("held_out", HeldOut()).by
    measured = "loops" if locked_end != NEITHER else "record" if record else "turns of a design"
    names, requirement = HELD_OUT_OF[measured]
    problems = [] if held_out_by in (None, *names) else [Mistake("held_out.by", held_out_by, requirement)]
    if measured == "loops":
        if side == "input" == locked_end:
            problems.append(Mistake("side", side, 'must be "output" where the input is locked: only that moves'))
        if parts.get("angle") == "absolute":
            problems.append(Mistake("angle", "absolute", 'requires locked = "neither"'))
        return problems
    offset, crank_angles = parts.get("offset", "common"), parts.get("crank_angles", "measured")
    if offset != "common":
        problems.append(Mistake("offset", offset, 'must be "common" where the crank turns: all rows have one zero'))
    if crank_angles != "measured":
        problems.append(Mistake("crank_angles", crank_angles, "a crank that turns is read from the drawing's zero"))
    if side == "input" and not record:
        problems.append(Mistake("side", side, 'must be "output" where the crank of a design turns'))
    return problems


def crank_problems(parts: Mapping[str, Any]) -> list[Mistake]:
    """A crank that moves has a signed ratio; it follows the angle at the motor's side of a locked output alone."""
    crank = parts.get("crank", CrankSection())
    problems = []
    if crank.moves != "fixed" and not crank.ratio:
        problems.append(Mistake("crank.ratio", crank.ratio, "where the crank moves, a number such as -13"))
    if crank.moves == "follows_angle" and parts.get("locked") != "output":
        requirement = 'requires locked = "output": the crank follows the angle of the motor\'s side'
        problems.append(Mistake("crank.moves", crank.moves, requirement))
    if (crank.moves == "column") != (crank.column is not None):
        problems.append(Mistake("crank.column", crank.column, 'name it with moves = "column", and only then'))
    return problems


def crank_of_design_problems(parts: Mapping[str, Any], design: Design | None) -> list[Mistake]:
    """The crank of a design turns by its own ratio, and in loops against a locked output alone."""
    crank = parts.get("crank", CrankSection())
    if design is None or crank.moves == "fixed":
        return []
    lobes = float(design.cycloid.lobes)
    problems = []
    if crank.ratio and crank.ratio != -lobes:
        problems.append(Mistake("crank.ratio", crank.ratio, f"the design has {lobes:g} lobes; give {-lobes:g}"))
    if parts.get("locked") != "output":
        problems.append(Mistake("crank.moves", crank.moves, 'with a design it requires locked = "output"'))
    return problems


def held_out_problems(parts: Mapping[str, Any]) -> list[Mistake]:
    """Training values without what they are of, or twice the same."""
    held_out = parts.get("held_out", HeldOut())
    if held_out.train and held_out.by is None:
        choices = '"cycle"' if parts.get("locked") == NEITHER else '"position" or "cycle"'
        return [Mistake("held_out.by", None, f"must be {choices} where train is listed")]
    if len(set(held_out.train)) < len(held_out.train):
        return [Mistake("held_out.train", held_out.train, "values must differ")]
    return []
