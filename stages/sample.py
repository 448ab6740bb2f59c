"""Stage 1: manufacturing errors of every sample, per pin, lobe and roller."""

from collections.abc import Iterator

import numpy as np

from pipeline.config.dimensions import Dimension, dimension_library
from pipeline.engine.stage import Chunk, Job, Stage, Tables
from pipeline.engine.table import Column, Table
from pipeline.sampling import Errors, draw
from stages.keys import SAMPLE as SAMPLE_COLUMN
from stages.keys import repeated


def _dimensions(table: str) -> list[Dimension]:
    """The dimensions of a table in the order of its columns."""
    dimensions = [dimension for dimension in dimension_library().values() if dimension.table == table]
    return sorted(dimensions, key=lambda dimension: dimension.drawn)


def _columns(table: str) -> Iterator[Column]:
    for dimension in _dimensions(table):
        yield Column(dimension.column, "float64", "um", dimension.meaning)
        if dimension.direction:
            yield Column(f"{dimension.phase}_rad", "float64", "rad", dimension.direction)


def _fields(table: str) -> dict[str, str]:
    """Column of a table to the name among the errors."""
    fields = {}
    for dimension in _dimensions(table):
        fields[dimension.column] = dimension.field
        if dimension.direction:
            fields[f"{dimension.phase}_rad"] = dimension.phase
    return fields


REDUCER = Table("reducer", "sample", (SAMPLE_COLUMN, *_columns("reducer")))
PINS = Table("pins", "sample, pin", (SAMPLE_COLUMN, Column("pin", "int32", "1", "pin, clockwise"), *_columns("pins")))
LOBES = Table(
    "lobes",
    "sample, disk, lobe",
    (
        SAMPLE_COLUMN,
        Column("disk", "int32", "1", "disk"),
        Column("lobe", "int32", "1", "lobe, clockwise"),
        *_columns("lobes"),
    ),
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


def columns_of_errors(errors: Errors, start: int, interfaces: int) -> Tables:
    """The four tables of errors whose first sample is ``start``."""
    number = np.arange(start, start + len(errors))
    values = {
        table: {column: getattr(errors, field).ravel() for column, field in _fields(table).items()}
        for table in ("reducer", "pins", "lobes", "rollers")
    }
    sample, pin = repeated(number, np.arange(errors.pin_radial.shape[1]))
    lobe_sample, disk, lobe = repeated(number, np.zeros(1, int), np.arange(errors.lobe_profile.shape[1]))
    per_interface = errors.roller_diameter.shape[1] // interfaces
    roller_sample, interface, roller = repeated(number, np.arange(interfaces), np.arange(per_interface))
    return {
        "reducer": {"sample": number, **values["reducer"]},
        "pins": {"sample": sample, "pin": pin, **values["pins"]},
        "lobes": {"sample": lobe_sample, "disk": disk, "lobe": lobe, **values["lobes"]},
        "rollers": {"sample": roller_sample, "interface": interface, "roller": roller, **values["rollers"]},
    }


def errors_of_columns(tables: Tables) -> Errors:
    """The errors of whole samples read back from the four tables."""
    n = len(tables["reducer"]["sample"])
    fields = {field: tables["reducer"][column] for column, field in _fields("reducer").items()}
    for table in ("pins", "lobes", "rollers"):
        fields |= {field: tables[table][column].reshape(n, -1) for column, field in _fields(table).items()}
    return Errors(**fields)


def _solve(study, chunk: Chunk) -> Tables:
    return columns_of_errors(draw(study, chunk.start, chunk.stop), chunk.start, study.design.output.interfaces)


def _items(job: Job) -> int:
    return job.study.samples.rows


def _prepare(job: Job):
    return job.study


SAMPLE = Stage(
    name="sample",
    reads=(),
    sections=("samples", "tolerances", "cases", "design.cycloid", "design.output.contacts", "design.output.interfaces"),
    tables=(REDUCER, PINS, LOBES, ROLLERS),
    module="stages.sample",
    unit="samples",
    items=_items,
    prepare=_prepare,
    solve=_solve,
)
