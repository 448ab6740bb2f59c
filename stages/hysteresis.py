"""Stage 4b: the load cycle of every sample at every loaded crank angle on the condensed model."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline import assembly
from pipeline.config.studies.study import Study
from pipeline.engine.stage import Chunk, Job, Stage, Tables
from pipeline.engine.table import Column, Table
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.load_history.load_cycle import LoadCycle
from pipeline.model.load_history.loop_readings import loop_readings
from pipeline.model.load_history.response import respond
from pipeline.model.load_history.validity import beyond_limit_share, invalid_metrics
from pipeline.model.metrics import library
from pipeline.model.turn import bearing_force, on_bearings, torque_shares
from pipeline.model.units import NM_PER_NMM
from pipeline.mounting import drive_of
from pipeline.sampling.errors import Errors
from stages.sample import SAMPLED_TABLES, errors_of_columns
from stages.springs import laws_of_columns
from stages.tables import over_turn
from stages.tables.condensed import COMPLIANCE_FILE, full_compliance
from stages.tables.curves import CONTACTS, CURVES, Solved, contact_rows, curve_rows
from stages.tables.keys import CRANK, SAMPLE, STATUS, repeated_axes


def _angle(name: str, meaning: str) -> Column:
    return Column(f"{name}_arcmin", "float64", "arcmin", f"angle of the output {meaning}")


READINGS = {
    "limit_minus": _angle("limit_minus", "without friction in the limit T -> 0-"),
    "limit_plus": _angle("limit_plus", "without friction in the limit T -> 0+"),
    "zero_falling": _angle("zero_falling", "at T = 0 on the way down from +T"),
    "zero_rising": _angle("zero_rising", "at T = 0 on the way up from -T"),
    "lost_motion_minus": _angle("lost_motion_minus", "of the centre line at minus the lost-motion torque"),
    "lost_motion_plus": _angle("lost_motion_plus", "of the centre line at the lost-motion torque"),
    "low_minus": _angle("low_minus", "on the way to -T at the lower torque of the rigidity"),
    "high_minus": _angle("high_minus", "on the way to -T at the higher torque of the rigidity"),
    "low_plus": _angle("low_plus", "on the way back to +T at the lower torque of the rigidity"),
    "high_plus": _angle("high_plus", "on the way back to +T at the higher torque of the rigidity"),
    "peak_pressure": Column("peak_pressure_MPa", "float64", "MPa", "largest Hertz pressure of any contact"),
    "load_share": Column("load_share", "float64", "1", "largest share of a disk in the torque; 1 of one disk"),
}
"""Columns of what the metrics are read from, by the field of `LoopReadings`."""

LOOPS = Table(
    "loops",
    "sample, crank",
    (
        SAMPLE,
        CRANK,
        Column("solved", "bool", "", "whether every load step reached equilibrium"),
        *READINGS.values(),
        *(
            Column(metric.valid_column, "bool", "", f"whether the {metric.inline} means what its definition says")
            for metric in library().values()
        ),
        Column(
            "bearing_force_N",
            "float64",
            "N",
            "largest force of a disk on its bearing, or on one of those on its cranks, at any torque of the loop",
        ),
        *over_turn.RUNNING,
        Column("beyond_limit_share", "float64", "1", "largest share of the pins' moment beyond the range of their law"),
    ),
)
STATUS_TABLE = Table("status", "sample, crank", (SAMPLE, CRANK, STATUS))


@dataclass(frozen=True)
class Shared:
    """What every chunk needs: per loaded crank angle the laws and the compliance of the contacts.

    Attributes
    ----------
    cranks : (n_angles,) [deg] the loaded crank angles.
    curve, brief : load cycles where whole curves are kept, and with the torques of the metrics alone.
    """

    study: Study
    cranks: tuple[float, ...]
    curve: LoadCycle
    brief: LoadCycle
    laws: tuple[ContactLaws, ...]
    compliances: tuple[np.ndarray, ...]

    def cycle(self, crank_deg: float) -> LoadCycle:
        """The load cycle at a crank angle [deg]."""
        return self.curve if crank_deg in self.study.cycle.curve_crank_deg else self.brief

    def at_some(self, angles: slice) -> "Shared":
        """The same at some of the loaded crank angles; the study keeps all of them."""
        return replace(self, cranks=self.cranks[angles], laws=self.laws[angles], compliances=self.compliances[angles])


def prepare(job: Job) -> Shared:
    """Read the laws and compliances of every crank angle."""
    study: Study = job.study
    cranks = study.cycle.crank_deg
    coefficients, matrices = job.read("springs", "coefficients"), job.input_path("reduce", COMPLIANCE_FILE)
    reducers = [assembly.reducer(study.design, crank) for crank in cranks]
    return Shared(
        study,
        cranks,
        assembly.load_cycle(study, study.cycle.levels_per_branch),
        assembly.load_cycle(study, 0),
        tuple(laws_of_columns(coefficients, crank) for crank in cranks),
        tuple(full_compliance(matrices, reducer, crank) for reducer, crank in zip(reducers, cranks, strict=True)),
    )


def solve_samples(loop_inputs: Shared, sampled_errors: Errors) -> Iterator[Solved]:
    """Every loaded crank angle of ``n`` units, one after the other: at a time their states are many."""
    study = loop_inputs.study
    errors = assembly.errors(sampled_errors)
    clearance = assembly.bearing_clearance(study.design, sampled_errors.bearing_clearance)
    for crank, laws, compliance in zip(loop_inputs.cranks, loop_inputs.laws, loop_inputs.compliances, strict=True):
        drive = drive_of(
            study, crank, compliance, errors, clearance, laws, assembly.modulus(study.design, sampled_errors)
        )
        response = respond(drive, loop_inputs.cycle(crank))
        yield Solved(crank, drive, response, invalid_metrics(drive, response, assembly.definitions(study)))


def loop_columns(study: Study, solution: Solved) -> dict[str, np.ndarray]:
    """What the table of loops says of every sample at one crank angle, (n,) each."""
    drive, response = solution.drive, solution.response
    states = response.equilibria
    peak = np.max(drive.laws_of_states.peak_pressure(np.max(states.force, axis=1, keepdims=True)), axis=(1, 2))
    shares = torque_shares(drive, response, assembly.definitions(study))
    readings = replace(loop_readings(response, peak, assembly.definitions(study)), load_share=shares.max(axis=(1, 2)))
    return {
        "solved": response.converged,
        **{column.name: getattr(readings, field) for field, column in READINGS.items()},
        **{library()[name].valid_column: reason == "" for name, reason in solution.invalid.items()},
        "bearing_force_N": np.max(np.abs(on_bearings(drive.reducer, states.force)), axis=(1, 2)),
        **over_turn.running_columns(study, drive, response),
        "beyond_limit_share": np.max(beyond_limit_share(drive, states), axis=1),
    }


def _status(solution: Solved) -> np.ndarray:
    """Status of every sample at one crank angle (n,): the first step that failed, or metrics that do not hold."""
    response = solution.response
    states = response.equilibria
    texts = np.full(len(response.converged), "ok", object)
    for sample in np.flatnonzero(np.any([reason != "" for reason in solution.invalid.values()], axis=0)):
        texts[sample] = _doubts({name: reason[sample] for name, reason in solution.invalid.items() if reason[sample]})
    for sample in np.flatnonzero(~response.converged):
        failed_steps = np.flatnonzero(~states.converged[sample, response.state])
        if len(failed_steps):
            torque = NM_PER_NMM * response.torque[failed_steps[0]]
            residual = states.residual[sample, response.state[failed_steps[0]]]
            texts[sample] = f"no equilibrium at {torque:.4g} N m or before: residual {residual:.1e}"
        else:
            texts[sample] = "no equilibrium without friction at the ends of the play"
    return texts


def _doubts(invalid: Mapping[str, str]) -> str:
    """Why metrics of one loop do not hold, each reason with the metrics that it takes."""
    by_reason: dict[str, list[str]] = {}
    for name, reason in invalid.items():
        by_reason.setdefault(reason, []).append(library()[name].inline)
    return "; ".join(f"{reason} ({', '.join(titles)} not valid)" for reason, titles in by_reason.items())


@dataclass(frozen=True)
class SolvedLoops:
    """Every loop of ``n`` units, the loaded angles of a unit one after the other.

    Attributes
    ----------
    columns : of the table of loops but for its keys (n_loops,).
    status : (n_loops,)
    bearing_force : (n, 2, n_angles, n_bearings) complex [N], of the disks on their bearings under the torque held.
    """

    columns: dict[str, np.ndarray]
    status: np.ndarray
    bearing_force: np.ndarray


def solved_loops(loop_inputs: Shared, sampled_errors: Errors) -> SolvedLoops:
    """Every loop of ``n`` units."""
    loops, status, thrust = [], [], []
    for solution in solve_samples(loop_inputs, sampled_errors):
        loops.append(loop_columns(loop_inputs.study, solution))
        status.append(_status(solution))
        thrust.append(bearing_force(solution.drive, solution.response, assembly.definitions(loop_inputs.study)))
    return SolvedLoops(_by_sample(loops), np.stack(status, axis=1).ravel(), np.stack(thrust, axis=2))


def mounting_forces(loop_inputs: Shared, sampled_errors: Errors) -> np.ndarray:
    """Largest contact force without torque (n,) [N] of ``n`` units at any loaded angle: what mounting them takes.

    A unit with play has none. Missing where a unit has no equilibrium.
    """
    forces = []
    for solution in solve_samples(replace(loop_inputs, curve=loop_inputs.brief), sampled_errors):
        response = solution.response
        at_rest = np.unique(response.state[response.torque == 0])
        force = np.max(response.equilibria.force[:, at_rest], axis=(1, 2))
        forces.append(np.where(response.converged, force, np.nan))
    largest: np.ndarray = np.max(forces, axis=0)
    return largest


def _by_sample(loops: Sequence[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Columns (n_loops,) of the loops of each crank angle (n,), the angles of a sample one after the other."""
    return {name: np.stack([loop[name] for loop in loops], axis=1).ravel() for name in loops[0]}


def _solve(loop_inputs: Shared, chunk: Chunk) -> Tables:
    samples = np.arange(chunk.start, chunk.stop)
    study = loop_inputs.study
    sampled_errors = errors_of_columns({name: chunk.tables[f"sample/{name}"] for name in SAMPLED_TABLES})
    keep = study.cycle.keep_contacts
    kept_samples = np.arange(len(samples)) if keep == "all" else np.flatnonzero(np.isin(samples, keep))
    loops, status, thrust, shares, curves, contacts = [], [], [], [], [], []
    for solution in solve_samples(loop_inputs, sampled_errors):
        loops.append(loop_columns(study, solution))
        status.append(_status(solution))
        thrust.append(bearing_force(solution.drive, solution.response, assembly.definitions(study)))
        shares.append(torque_shares(solution.drive, solution.response, assembly.definitions(study)))
        contacts.append(over_turn.contacts_at_angle(study, solution.drive, solution.response, kept_samples))
        if solution.crank_deg in study.cycle.curve_crank_deg:
            curves.append(solution)
    sample, crank = repeated_axes(samples, np.array(study.cycle.crank_deg))
    return {
        "loops": {"sample": sample, "crank_deg": crank, **_by_sample(loops)},
        "turn_contacts": over_turn.turn_contact_rows(study, samples[kept_samples], contacts),
        "bearings": over_turn.bearing_rows(study, samples, np.stack(thrust, axis=2), np.stack(shares, axis=2)),
        "curves": curve_rows(samples, curves),
        "contacts": contact_rows(samples[kept_samples], [loop.some(kept_samples) for loop in curves])
        if len(kept_samples)
        else CONTACTS.empty(),
        "status": {"sample": sample, "crank_deg": crank, "status": np.stack(status, axis=1).ravel()},
    }


def _failures(tables: Tables) -> int:
    """Number of samples that have no result at some crank angle."""
    columns = tables["loops"]
    return len(np.unique(columns["sample"][~columns["solved"]]))


HYSTERESIS = Stage(
    name="hysteresis",
    reads=("sample", "springs", "reduce"),
    sections=(
        "samples",
        "design.cycloid",
        "design.disk",
        "design.materials",
        "design.bearing",
        "design.output",
        "design.operation",
        "design.flank",
        "design.housing.ring",
        "design.input_shaft",
        "design.series",
        "design.effects",
        "design.temperature_rise_K",
        "design.thermal",
        "clearance",
        "cycle.crank_deg",
        "cycle.curve_crank_deg",
        "cycle.levels_per_branch",
        "cycle.torque_fraction",
        "cycle.keep_contacts",
        "metrics.lost_motion_percent",
        "metrics.rigidity_percent",
    ),
    tables=(LOOPS, over_turn.BEARINGS, CURVES, CONTACTS, over_turn.TURN_CONTACTS, STATUS_TABLE),
    module="stages.hysteresis",
    unit="samples",
    items=lambda job: job.study.samples.rows,
    prepare=prepare,
    solve=_solve,
    chunk_reads=tuple(f"sample/{name}" for name in SAMPLED_TABLES),
    failures=_failures,
    proportional_to=("cycle.crank_deg", "design.cycloid.pins"),
    unit_seconds=1.5e-6,
)
