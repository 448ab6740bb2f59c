"""Stage 1: manufacturing errors of every sample, per disk, pin, lobe and roller."""

from collections.abc import Iterator, Mapping

import numpy as np

from pipeline.arrays import Index
from pipeline.config.dimensions import Dimension, dimension_library
from pipeline.config.dimensions.dimension import DISKS as OF_DISKS
from pipeline.config.dimensions.dimension import REDUCER as OF_REDUCER
from pipeline.config.studies.study import Study
from pipeline.engine.stage import Chunk, Stage, Tables
from pipeline.engine.table import Column, Table
from pipeline.sampling.errors import Errors, draw
from stages.tables.keys import SAMPLE as SAMPLE_COLUMN
from stages.tables.keys import repeated_axes


def _dimensions(table: str) -> list[Dimension]:
    """The dimensions of a table in the order of its columns; what each disk has once stands in two tables."""
    library = dimension_library().values()
    if table == OF_DISKS:
        dimensions = [dimension for dimension in library if dimension.table == OF_REDUCER and dimension.of_disk]
    else:
        dimensions = [dimension for dimension in library if dimension.table == table and dimension.fewest_disks == 1]
    return sorted(dimensions, key=lambda dimension: dimension.draw_columns)


def _columns(table: str) -> Iterator[Column]:
    for dimension in _dimensions(table):
        yield Column(dimension.column, "float64", "um", dimension.meaning)
        if dimension.direction:
            yield Column(dimension.phase_column, "float64", "rad", dimension.direction)


def _fields(table: str) -> dict[str, str]:
    """Column of a table to the name among the errors."""
    fields = {}
    for dimension in _dimensions(table):
        fields[dimension.column] = dimension.field
        if dimension.direction:
            fields[dimension.phase_column] = dimension.phase
    return fields


DISK_COLUMN = Column("disk", "int32", "1", "disk, in the sense of the crank")
REDUCER = Table(OF_REDUCER, "sample", (SAMPLE_COLUMN, *_columns(OF_REDUCER)))
"""What belongs to the disks is that of disk 0."""
DISKS = Table(OF_DISKS, "sample, disk", (SAMPLE_COLUMN, DISK_COLUMN, *_columns(OF_DISKS)))
PINS = Table("pins", "sample, pin", (SAMPLE_COLUMN, Column("pin", "int32", "1", "pin, clockwise"), *_columns("pins")))
LOBES = Table(
    "lobes",
    "sample, disk, lobe",
    (SAMPLE_COLUMN, DISK_COLUMN, Column("lobe", "int32", "1", "lobe, clockwise"), *_columns("lobes")),
)
ROLLERS = Table(
    "rollers",
    "sample, interface, roller",
    (
        SAMPLE_COLUMN,
        Column("interface", "int32", "1", "0: disk and plate, 1: plate and output; pins in holes: 0"),
        Column(
            "roller", "int32", "1", "roller of the interface: by face, end, and from outside to inside; or output pin"
        ),
        *_columns("rollers"),
    ),
)
HOLES = Table(
    "holes",
    "sample, disk, hole",
    (
        SAMPLE_COLUMN,
        DISK_COLUMN,
        Column("hole", "int32", "1", "hole of the disk, by the output pin or crank in it; a disk without has no rows"),
        *_columns("holes"),
    ),
)

CRANKS = Table(
    "cranks",
    "sample, crank",
    (
        SAMPLE_COLUMN,
        Column("crank", "int32", "1", "crank of a carrier, clockwise; other mechanisms have no rows"),
        *_columns("cranks"),
    ),
)

TABLES = (REDUCER, DISKS, PINS, LOBES, ROLLERS, HOLES, CRANKS)
SAMPLED_TABLES = tuple(table.name for table in TABLES)
"""Names of the tables of errors."""


def columns_of_errors(errors: Errors, start: int, interfaces: int) -> Tables:
    """The tables of errors whose first sample is ``start``."""
    number = np.arange(start, start + len(errors))
    disks = errors.eccentricity.size // max(len(errors), 1)
    columns = {table: _fields(table).items() for table in SAMPLED_TABLES}
    values = {
        table: {name: getattr(errors, field).ravel() for name, field in columns[table]} for table in SAMPLED_TABLES
    }
    values[OF_REDUCER] = {
        name: getattr(errors, field).reshape(len(errors), -1)[:, 0] for name, field in columns[OF_REDUCER]
    }
    elements = {
        OF_REDUCER: {},
        OF_DISKS: {"disk": disks},
        "pins": {"pin": errors.pin_radial.shape[1]},
        "lobes": {"disk": disks, "lobe": errors.lobe_profile.shape[1] // disks},
        "holes": {"disk": disks, "hole": errors.hole_diameter.shape[1] // disks},
        "cranks": {"crank": errors.planet_backlash.shape[1]},
        "rollers": {"interface": interfaces, "roller": errors.roller_diameter.shape[1] // interfaces},
    }
    keys = {table: _keys(number, counts) for table, counts in elements.items()}
    return {table: {**keys[table], **values[table]} for table in SAMPLED_TABLES}


def _keys(samples: Index, counts: Mapping[str, int]) -> dict[str, np.ndarray]:
    """Columns of the samples and of so many elements of each kind."""
    axes = {"sample": samples} | {name: np.arange(count) for name, count in counts.items()}
    return dict(zip(axes, repeated_axes(*axes.values()), strict=True))


def errors_of_columns(tables: Tables) -> Errors:
    """The errors of whole samples read back from their tables."""
    n = len(tables[OF_REDUCER]["sample"])
    fields = {field: tables[OF_REDUCER][column] for column, field in _fields(OF_REDUCER).items()}
    for table in SAMPLED_TABLES[1:]:
        elements = len(tables[table]["sample"]) // n  # a table without rows has none
        fields |= {field: tables[table][column].reshape(n, elements) for column, field in _fields(table).items()}
    if len(tables[OF_DISKS]["disk"]) == n:
        fields |= {field: fields[field][:, 0] for field in _fields(OF_DISKS).values()}
    return Errors(**fields)


def _solve(study: Study, chunk: Chunk) -> Tables:
    return columns_of_errors(draw(study, chunk.start, chunk.stop), chunk.start, study.design.output.interfaces)


SAMPLE = Stage(
    name="sample",
    reads=(),
    sections=(
        "samples",
        "tolerances",
        "cases",
        "design.cycloid",
        "design.disk.count",
        "design.output.contacts",
        "design.output.interfaces",
        "design.output.pins_in_holes",
        "design.output.holes_in_disk",
        "design.output.carries_disks",
        "design.output.has_bushes",
        "design.output.has_loose_supports",
        "design.operation",
        "design.thermal",
    ),
    tables=TABLES,
    module="stages.sample",
    unit="samples",
    items=lambda job: job.study.samples.rows,
    prepare=lambda job: job.study,
    solve=_solve,
)
