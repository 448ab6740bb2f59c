"""Sections of the file `unit.toml` of a measured unit."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from pipeline.config.files.section import (
    Positive,
    Section,
)
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
