"""Whole curves of a load cycle and the contacts behind them: their tables and rows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.engine.table import Column, Columns, Table
from pipeline.model.geometry.contacts import PIN
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.load_cycle import ARCMIN, BRANCHES
from pipeline.model.load_history.response import CycleResponse
from pipeline.model.load_history.validity import beyond_limit_share
from pipeline.model.units import NM_PER_NMM, UM_PER_MM
from stages.tables.keys import CONTACT, CRANK, FORCE, PRESSURE, SAMPLE, labels, repeated_axes

STEP = Column("step", "int32", "1", "step of the load cycle")
TORQUE = Column("torque_Nm", "float64", "N m", "torque on the output; 0 stands for its limit from the branch's side")

CURVES = Table(
    "curves",
    "sample, crank of a kept curve, step",
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
    "kept sample, crank of a kept curve, step, contact",
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
        FORCE,
        PRESSURE,
    ),
)


@dataclass(frozen=True)
class Solved:
    """The drive of ``n`` samples at one crank angle, its response to the load cycle, and why metrics do not hold."""

    crank_deg: float
    drive: Drive
    response: CycleResponse
    invalid: Mapping[str, np.ndarray]

    def some(self, samples: np.ndarray) -> "Solved":
        """Of some of the samples alone, by their positions."""
        whole_response = self.response
        of_samples = {name: getattr(whole_response, name)[samples] for name in ("angle", "play", "converged")}
        invalid = {name: reason[samples] for name, reason in self.invalid.items()}
        response = replace(whole_response, equilibria=whole_response.equilibria[samples], **of_samples)
        return Solved(self.crank_deg, self.drive.some(samples), response, invalid)


def _curve_values(solution: Solved) -> dict[str, np.ndarray]:
    """Values of the curve table at every step, (n, n_steps) each."""
    drive, response = solution.drive, solution.response
    states = response.equilibria
    in_contact = states.force > 0
    of_pins = drive.reducer.contacts.kind == PIN
    of_states = {
        "bearing_x_um": UM_PER_MM * states.motion[..., 0],
        "bearing_y_um": UM_PER_MM * states.motion[..., 1],
        "pins_in_contact": np.count_nonzero(in_contact[..., of_pins], axis=2),
        "outputs_in_contact": np.count_nonzero(in_contact[..., ~of_pins], axis=2),
        "peak_pressure_MPa": np.max(drive.laws_of_states.peak_pressure(states.force), axis=2),
        "beyond_limit_share": beyond_limit_share(drive, states),
        "iterations": states.iterations,
        "residual": states.residual,
    }
    state_values = {name: values[:, response.state] for name, values in of_states.items()}
    return {"angle_arcmin": ARCMIN * response.angle, **state_values}


def curve_rows(samples: np.ndarray, curves: Sequence[Solved]) -> Columns:
    """Rows of the table of curves for ``samples`` (n,), solved at each kept crank angle."""
    branch, torque = curves[0].response.branch, curves[0].response.torque
    sample, crank, step = repeated_axes(
        samples, np.array([solution.crank_deg for solution in curves]), np.arange(len(torque))
    )
    values = [_curve_values(solution) for solution in curves]
    loops = len(samples) * len(curves)
    return {
        "sample": sample,
        "crank_deg": crank,
        "step": step,
        "branch": labels(np.tile(branch, loops), BRANCHES),
        "torque_Nm": np.tile(NM_PER_NMM * torque, loops),
        **{name: np.stack([part[name] for part in values], axis=1).ravel() for name in values[0]},
    }


def contact_rows(samples: np.ndarray, curves: Sequence[Solved]) -> Columns:
    """Rows of the table of contacts for ``samples`` (n,), solved at each kept crank angle."""
    torque = NM_PER_NMM * curves[0].response.torque
    contacts = curves[0].drive.gap.shape[1]
    cranks = np.array([solution.crank_deg for solution in curves])
    sample, crank, step, contact = repeated_axes(samples, cranks, np.arange(len(torque)), np.arange(contacts))
    parts = []
    for solution in curves:
        drive, states, state_values = solution.drive, solution.response.equilibria, solution.response.state
        force = states.force[:, state_values]
        local, elastic = drive.laws_of_states.deflection(force), drive.elastic_deflection(force)
        parts.append(
            {
                "clearance_um": UM_PER_MM * np.broadcast_to(drive.gap[:, None], force.shape),
                "approach_um": UM_PER_MM * states.motion[:, state_values] @ drive.reducer.contact_jacobian.T,
                "penetration_um": UM_PER_MM * (local + elastic),
                "elastic_um": UM_PER_MM * elastic,
                "local_um": UM_PER_MM * local,
                "force_N": force,
                "pressure_MPa": drive.laws_of_states.peak_pressure(force),
            }
        )
    return {
        "sample": sample,
        "crank_deg": crank,
        "step": step,
        "torque_Nm": np.broadcast_to(torque[:, None], (len(samples), len(cranks), len(torque), contacts)).ravel(),
        "contact": contact,
        **{name: np.stack([part[name] for part in parts], axis=1).ravel() for name in parts[0]},
    }
