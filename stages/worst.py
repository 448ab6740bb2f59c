"""Stage 4e: the worst of every sample over the whole turn of the output, by search; some samples at every pitch."""

from dataclasses import dataclass

import numpy as np

from pipeline import assembly
from pipeline.arrays import Index
from pipeline.config.studies.study import Study
from pipeline.engine.stage import Chunk, Job, Stage, Tables
from pipeline.engine.table import Column, Table
from pipeline.model.metrics import library
from pipeline.model.metrics.turn import turn_library
from pipeline.model.units import UM_PER_MM
from pipeline.populations.turn_drives import TurnDrives, Units, full_blocks, symmetric, turned_blocks
from pipeline.populations.turn_ranking import Ranking
from pipeline.populations.turn_search import TRAINING_UNITS, Worst, search_and_audit, train_ranking
from stages.reduce import DiskMatrices
from stages.sample import SAMPLED_TABLES, errors_of_columns
from stages.tables.keys import SAMPLE

PHASES = 5
"""Phases of a pitch that are looked at beside the worst pitches, of disks that one condensation serves."""
TRAINING, AUDIT_DRAW = 2**31 + 1, 2**31 + 2
"""Keys of the random numbers by which pitches for the ranking and audited samples are drawn."""
FOUND_COLUMNS = tuple(
    column
    for name, metric in library().items()
    for column in (
        Column(f"{name}_worst", "float64", metric.unit, f"{metric.inline}, the worst that was found; null without one"),
        Column(f"{name}_at_crank_deg", "float64", "deg", "crank angle where it was found"),
    )
)
SOLVED_COLUMN = Column("n_solved", "int32", "1", "pitches and phases of them at which the sample was load-solved")
OF_PITCHES = {
    name: Column(f"{name}_at_pitches", "float64", metric.unit, f"{metric.inline}, the worst of one phase of each pitch")
    for name, metric in library().items()
}
"""Columns of the worst at all pitches, without the phases between them, by metric."""
RANGES = {
    name: Column(name, "float64", metric.unit, f"{metric.inline} over the pitches that were solved; null without one")
    for name, metric in turn_library().items()
    if metric.angles
}
"""Columns of the metrics of the turn that are the range of an angle, by metric."""
SEARCH = Table("found", "sample", (SAMPLE, *FOUND_COLUMNS, *RANGES.values(), SOLVED_COLUMN))
N_PHASES = Column("n_phases", "int32", "1", "phases of a pitch that are examined beside the worst pitches; 1: none")
AUDIT = Table(
    "audit",
    "sample that was solved at every pitch",
    (SAMPLE, *FOUND_COLUMNS, *RANGES.values(), SOLVED_COLUMN, *OF_PITCHES.values(), N_PHASES),
)


@dataclass(frozen=True)
class Shared:
    """What every chunk needs: the drives over the turn, the ranking of its pitches, and the audited samples."""

    drives: TurnDrives
    ranking: Ranking
    audited_samples: Index


def drives_of(study: Study, disks: DiskMatrices, phases: int = PHASES) -> TurnDrives:
    """The drives of a study over the turn of its output, at so many phases of a pitch where they cost nothing."""
    pins = study.design.cycloid.pins
    if study.reduce.disk == "rigid":
        n_contacts = len(assembly.reducer(study.design, 0.0).contacts)
        return TurnDrives.from_blocks(study, phases, [np.zeros((1, n_contacts, n_contacts))] * phases)
    if symmetric(study):
        cranks = [360.0 * phase / (pins * phases) for phase in range(phases)]
        return TurnDrives.from_blocks(study, phases, [turned_blocks(study, disks.body(), crank) for crank in cranks])
    blocks = full_blocks(study, 0.0, lambda crank: [matrix / UM_PER_MM for matrix in disks.at_crank(crank)])
    return TurnDrives.from_blocks(study, 1, [blocks])


def audited_samples(study: Study) -> Index:
    """Numbers of the samples that are solved at every pitch, ascending: drawn from all but the nominal one."""
    first_unit, rows = int(study.samples.nominal_first), study.samples.rows
    rng = np.random.default_rng(np.random.SeedSequence(study.samples.seed, spawn_key=(AUDIT_DRAW,)))
    count = min(study.cycle.audited_units, rows - first_unit)
    return np.sort(rng.choice(np.arange(first_unit, rows), count, replace=False))


def prepare(job: Job) -> Shared | None:
    """The drives of the whole turn, ranked, and the audited samples; None without a search."""
    if not job.study.cycle.has_turn_search:
        return None
    return Shared(*ranked_drives(job), audited_samples(job.study))


def ranked_drives(job: Job) -> tuple[TurnDrives, Ranking]:
    """Condense the disks for the whole turn, and train the ranking of its pitches on the first samples."""
    study: Study = job.study
    drives, stop = drives_of(study, DiskMatrices(job)), min(study.samples.rows, TRAINING_UNITS)
    units = units_of(study, {name: job.read_items("sample", name, 0, stop) for name in SAMPLED_TABLES})
    seed = np.random.SeedSequence(study.samples.seed, spawn_key=(TRAINING,))
    return drives, train_ranking(drives, units, seed)


def units_of(study: Study, tables: Tables) -> Units:
    """Units of the tables of errors."""
    return Units.from_errors(study, errors_of_columns(tables))


def _solve(search_inputs: Shared, chunk: Chunk) -> Tables:
    drives, samples = search_inputs.drives, np.arange(chunk.start, chunk.stop)
    units = units_of(drives.study, {name: chunk.tables[f"sample/{name}"] for name in SAMPLED_TABLES})
    audited_rows = np.flatnonzero(np.isin(samples, search_inputs.audited_samples))
    found, of_pitches, audited = search_and_audit(drives, search_inputs.ranking, units, audited_rows)
    at_pitches = {OF_PITCHES[name].name: values for name, values in of_pitches.value.items()}
    n_phases = {N_PHASES.name: np.full(len(audited_rows), drives.phases, np.int32)}
    audit_columns = _columns(drives, samples[audited_rows], audited) | at_pitches | n_phases
    return {"found": _columns(drives, samples, found), "audit": audit_columns}


def _columns(drives: TurnDrives, samples: Index, worst_values: Worst) -> dict[str, np.ndarray]:
    columns: dict[str, np.ndarray] = {"sample": samples}
    for name, values in worst_values.value.items():
        columns[f"{name}_worst"] = values
        columns[f"{name}_at_crank_deg"] = np.where(np.isnan(values), np.nan, drives.crank_deg(worst_values.step[name]))
    ranges = {name: worst_values.of_turn[name] for name in RANGES}
    return columns | ranges | {"n_solved": worst_values.n_solved}


WORST = Stage(
    name="worst",
    reads=("sample",),
    sections=(
        "samples",
        "design",
        "clearance",
        "springs",
        "reduce",
        "cycle.has_turn_search",
        "cycle.audited_units",
        "cycle.torque_fraction",
        "metrics.lost_motion_percent",
        "metrics.rigidity_percent",
    ),
    tables=(SEARCH, AUDIT),
    module="stages.worst",
    unit="samples",
    items=lambda job: job.study.samples.rows if job.study.cycle.has_turn_search else 0,
    prepare=prepare,
    solve=_solve,
    chunk_reads=tuple(f"sample/{name}" for name in SAMPLED_TABLES),
    chunk_factor=10,
    proportional_to=("design.cycloid.pins",),
    unit_seconds=2.9e-4,
)
