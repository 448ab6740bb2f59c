"""Stage 4b: the load cycle of every sample at every crank angle on the condensed model."""

from dataclasses import dataclass

import numpy as np

from pipeline import assembly
from pipeline.config.study import Study
from pipeline.engine.stage import Chunk, Job, Stage, Tables
from pipeline.engine.table import Column, Columns, Table
from pipeline.model.contact.friction_elements import Sliders
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.equilibrium.solve import Equilibria
from pipeline.model.geometry.clearance import Errors
from pipeline.model.geometry.reducer import PIN, Bearing, Reducer
from pipeline.model.load_history.drive import Drive, GapReading
from pipeline.model.load_history.frictional_cycle import refined, solve_frictional_cycle
from pipeline.model.load_history.load_cycle import ARCMIN, BRANCHES, LoadCycle, solve_cycle
from pipeline.mounting import with_effects
from stages.condensed import COMPLIANCE_FILE, UM_PER_MM, full_compliance
from stages.keys import CONTACT, CRANK, SAMPLE, STATUS, labels, repeated
from stages.springs import laws_of_columns

NM_PER_NMM = 1e-3
STEP = Column("step", "int32", "1", "step of the load cycle")
TORQUE = Column("torque_Nm", "float64", "N m", "torque on the output; 0 stands for its limit from the branch's side")

CURVES = Table(
    "curves",
    "sample, crank, step",
    (
        SAMPLE,
        CRANK,
        STEP,
        Column("branch", "label", "", "branch of the cycle 0 -> +T -> -T -> +T"),
        TORQUE,
        Column("angle_arcmin", "float64", "arcmin", "rotation of the output, the input held"),
        Column("bearing_x_um", "float64", "um", "displacement of the disk centre, housing frame"),
        Column("bearing_y_um", "float64", "um", "displacement of the disk centre, housing frame"),
        Column("pins_in_contact", "int32", "1", "pins that carry force"),
        Column("outputs_in_contact", "int32", "1", "output contacts that carry force"),
        Column("peak_pressure_MPa", "float64", "MPa", "largest Hertz pressure of any contact"),
        Column("beyond_limit_share", "float64", "1", "share of the pins' moment on contacts beyond their law's range"),
        Column("iterations", "int32", "1", "Newton steps; 0 at the force-free ends of play"),
        Column("residual", "float64", "1", "relative misfit of deflections and of the balance"),
    ),
)
CONTACTS = Table(
    "contacts",
    "kept sample, crank, step, contact",
    (
        SAMPLE,
        CRANK,
        STEP,
        TORQUE,
        CONTACT,
        Column("clearance_um", "float64", "um", "gap at the nominal pose"),
        Column(
            "approach_um", "float64", "um", "approach of the two bodies from the nominal pose by their rigid motions"
        ),
        Column("penetration_um", "float64", "um", "elastic_um + local_um; of a closed contact approach less clearance"),
        Column("elastic_um", "float64", "um", "deflection of the elastic bodies at the contact"),
        Column("local_um", "float64", "um", "local deflection, the law's at force_N"),
        Column("force_N", "float64", "N", "contact force"),
        Column("pressure_MPa", "float64", "MPa", "peak Hertz pressure"),
    ),
)
STATUS_TABLE = Table("status", "sample, crank", (SAMPLE, CRANK, STATUS))


@dataclass(frozen=True)
class Shared:
    """What every chunk needs, per crank angle, with the design's effects.

    Attributes
    ----------
    looser : clearance of the bearing beyond the design's and the sample's [mm].
    torsion : compliance between the reducer's output and the torque [rad/(N mm)].
    """

    study: Study
    cycle: LoadCycle
    bearing: Bearing
    reducers: tuple[Reducer, ...]
    laws: tuple[ContactLaws, ...]
    compliances: tuple[np.ndarray, ...]
    sliders: tuple[Sliders, ...]
    looser: tuple[float, ...]
    torsion: tuple[float, ...]

    @property
    def frictional(self) -> bool:
        """Whether a state depends on the way to it, so that every step has its own."""
        return any(len(sliders.acting) for sliders in self.sliders)

    @property
    def steps(self) -> tuple[np.ndarray, np.ndarray]:
        """Branch number and state of every step of the cycle, (n_steps,) each."""
        branch, state = self.cycle.steps
        return branch, np.arange(len(state)) if self.frictional else state

    @property
    def state_torque(self) -> np.ndarray:
        """Torque of every state (n_states,) [N mm]."""
        torque = self.cycle.state_torque
        return torque[self.cycle.steps[1]] if self.frictional else torque


def _mounted(study: Study, at: Reducer, laws: ContactLaws, compliance: np.ndarray) -> Drive:
    """The nominal drive with the design's effects; the gaps of the samples come from the stage clearance."""
    cycloid, contacts = study.design.cycloid, len(at.contacts)
    pins = np.zeros((1, cycloid.pins))
    drive = Drive(
        profile=assembly.profile(study.design),
        reducer=at,
        bearing=assembly.bearing(study.design),
        laws=laws,
        compliance=compliance,
        rated_torque=assembly.NMM_PER_NM * cycloid.rated_torque_Nm,
        errors=Errors(pins, pins, pins, np.zeros((1, cycloid.lobes)), np.zeros(1), np.zeros((1, contacts - at.n_pins))),
        reading=GapReading(**dict(study.clearance)),
        shift=np.zeros((1, contacts)),
        bearing_clearance=np.zeros(1),
    )
    return with_effects(drive, study.design.effects)


def prepare(job: Job) -> Shared:
    """Read the laws and compliances of every crank angle."""
    study: Study = job.study
    cranks = study.cycle.crank_deg
    reducers = tuple(assembly.reducer(study.design, crank) for crank in cranks)
    coefficients, matrices = job.read("springs", "coefficients"), job.input_path("reduce", COMPLIANCE_FILE)
    drives = [
        _mounted(study, at, laws_of_columns(coefficients, crank), full_compliance(matrices, at, crank))
        for at, crank in zip(reducers, cranks, strict=True)
    ]
    return Shared(
        study,
        assembly.load_cycle(study),
        assembly.bearing(study.design),
        reducers,
        tuple(drive.laws for drive in drives),
        tuple(drive.compliance for drive in drives),
        tuple(drive.sliders for drive in drives),
        tuple(float(drive.bearing_clearance[0]) for drive in drives),
        tuple(drive.torsion for drive in drives),
    )


def solve_samples(shared: Shared, gap_um: np.ndarray, bearing_um: np.ndarray) -> list[Equilibria]:
    """States of the cycle per crank angle; ``gap_um`` (n, n_cranks, n_contacts), ``bearing_um`` (n,)."""
    loose = assembly.bearing_clearance(shared.study.design, bearing_um)
    solved = []
    for k, at in enumerate(shared.reducers):
        spring = at, shared.bearing, shared.laws[k], shared.compliances[k]
        of_samples = gap_um[:, k] / UM_PER_MM, loose + shared.looser[k]
        if shared.frictional:
            states = solve_cycle(*spring, *of_samples, refined(shared.cycle))
            solved.append(solve_frictional_cycle(*spring, *of_samples, shared.cycle, shared.sliders[k], states))
        else:
            solved.append(solve_cycle(*spring, *of_samples, shared.cycle))
    return solved


def _curve_values(at: Reducer, laws: ContactLaws, states: Equilibria, twist: np.ndarray) -> dict[str, np.ndarray]:
    """Values of the curve table at every state, (n, n_states) each; ``twist`` (n_states,) [rad] lies behind it."""
    of_pins = at.contacts.kind == PIN
    closed = states.force > 0
    moment = np.abs(at.contacts.arm[of_pins]) * states.force[..., of_pins]
    beyond = np.sum(moment, axis=2, where=states.force[..., of_pins] > laws.force_limit[of_pins])
    whole = np.sum(moment, axis=2)
    return {
        "angle_arcmin": ARCMIN * (states.motion[..., at.output_motion] + twist),
        "bearing_x_um": UM_PER_MM * states.motion[..., 0],
        "bearing_y_um": UM_PER_MM * states.motion[..., 1],
        "pins_in_contact": np.count_nonzero(closed[..., of_pins], axis=2),
        "outputs_in_contact": np.count_nonzero(closed[..., ~of_pins], axis=2),
        "peak_pressure_MPa": np.max(laws.peak_pressure(states.force), axis=2),
        "beyond_limit_share": np.divide(beyond, whole, out=np.zeros_like(whole), where=whole > 0),
        "iterations": states.iterations,
        "residual": states.residual,
    }


def _curve_rows(shared: Shared, samples: np.ndarray, solved: list[Equilibria]) -> Columns:
    branch, state = shared.steps
    cranks = np.array(shared.study.cycle.crank_deg)
    sample, crank, step = repeated(samples, cranks, np.arange(len(state)))
    values = [
        _curve_values(at, laws, states, torsion * shared.state_torque)
        for at, laws, states, torsion in zip(shared.reducers, shared.laws, solved, shared.torsion, strict=True)
    ]
    loops = len(samples) * len(cranks)
    return {
        "sample": sample,
        "crank_deg": crank,
        "step": step,
        "branch": labels(np.tile(branch, loops), BRANCHES),
        "torque_Nm": np.tile(NM_PER_NMM * shared.state_torque[state], loops),
        **{name: np.stack([one[name][:, state] for one in values], axis=1).ravel() for name in values[0]},
    }


def contact_rows(shared: Shared, samples: np.ndarray, gap_um: np.ndarray, solved: list[Equilibria]) -> Columns:
    """Rows of the table of contacts for ``samples`` (n,), whose states are ``solved`` per crank angle."""
    _, state = shared.steps
    cranks = np.array(shared.study.cycle.crank_deg)
    sample, crank, step, contact = repeated(samples, cranks, np.arange(len(state)), np.arange(gap_um.shape[2]))
    parts = []
    for k, (at, laws, compliance, states) in enumerate(
        zip(shared.reducers, shared.laws, shared.compliances, solved, strict=True)
    ):
        force = states.force[:, state]
        local, elastic = laws.deflection(force), force @ compliance
        parts.append(
            {
                "clearance_um": np.broadcast_to(gap_um[:, k, None], force.shape),
                "approach_um": UM_PER_MM * states.motion[:, state] @ at.closing.T,
                "penetration_um": UM_PER_MM * (local + elastic),
                "elastic_um": UM_PER_MM * elastic,
                "local_um": UM_PER_MM * local,
                "force_N": force,
                "pressure_MPa": laws.peak_pressure(force),
            }
        )
    torque = NM_PER_NMM * shared.state_torque[state]
    return {
        "sample": sample,
        "crank_deg": crank,
        "step": step,
        "torque_Nm": np.broadcast_to(torque[:, None], (len(samples), len(cranks), len(state), gap_um.shape[2])).ravel(),
        "contact": contact,
        **{name: np.stack([part[name] for part in parts], axis=1).ravel() for name in parts[0]},
    }


def _status(shared: Shared, states: Equilibria) -> list[str]:
    """Status of every sample at one crank angle: the first step that failed, if any."""
    texts = np.full(len(states.converged), "ok", object)
    for sample in np.flatnonzero(~np.all(states.converged, axis=1)):
        first = int(np.argmin(states.converged[sample]))
        torque, residual = NM_PER_NMM * shared.state_torque[first], states.residual[sample, first]
        where = "on the way" if shared.frictional else f"at {torque:.4g} N m"
        texts[sample] = f"no equilibrium {where}: residual {residual:.1e}"
    return list(texts)


def _solve(shared: Shared, chunk: Chunk) -> Tables:
    samples = np.arange(chunk.start, chunk.stop)
    cranks = np.array(shared.study.cycle.crank_deg)
    gap_um = chunk.tables["clearance/gaps"]["clearance_um"].reshape(len(samples), len(cranks), -1)
    solved = solve_samples(shared, gap_um, chunk.tables["sample/reducer"]["bearing_clearance_um"])
    keep = shared.study.cycle.keep_contacts
    kept = np.arange(len(samples)) if keep == "all" else np.flatnonzero(np.isin(samples, keep))
    sample, crank = repeated(samples, cranks)
    status = np.array([_status(shared, states) for states in solved], object).T
    few = [Equilibria(**{name: values[kept] for name, values in vars(states).items()}) for states in solved]
    return {
        "curves": _curve_rows(shared, samples, solved),
        "contacts": contact_rows(shared, samples[kept], gap_um[kept], few) if len(kept) else CONTACTS.empty(),
        "status": {"sample": sample, "crank_deg": crank, "status": status.ravel()},
    }


def _failures(tables: Tables) -> int:
    """Number of samples that have no result at some crank angle."""
    columns = tables["status"]
    return len(np.unique(columns["sample"][np.asarray(columns["status"]) != "ok"]))


HYSTERESIS = Stage(
    name="hysteresis",
    reads=("sample", "clearance", "springs", "reduce"),
    sections=(
        "samples",
        "design.cycloid",
        "design.bearing",
        "design.output",
        "design.effects",
        "clearance",
        "cycle",
        "metrics.lost_motion_percent",
        "metrics.rigidity_percent",
    ),
    tables=(CURVES, CONTACTS, STATUS_TABLE),
    module="stages.hysteresis",
    unit="samples",
    items=lambda job: job.study.samples.rows,
    prepare=prepare,
    solve=_solve,
    chunk_reads=("clearance/gaps", "sample/reducer"),
    failures=_failures,
)
