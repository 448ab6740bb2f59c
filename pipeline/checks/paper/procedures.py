"""The direct procedure against the iterative one that it replaces (the paper's sections 1 and 3.2, its Fig. 8).

Iterative: a kinematic analysis finds which contacts touch, an FE analysis with those contacts held closed finds forces
and motions, kinematics finds the contacts anew, until the set settles. Both use the same condensed disk and laws.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline import assembly
from pipeline.arrays import Real
from pipeline.checks.response import Condensed, SolvedCases
from pipeline.config import Study
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.equilibrium.solve import ElasticReducer, solve
from pipeline.model.geometry.reducer import Bearing, Reducer
from pipeline.model.geometry.rigid_play.rigid_backlash import rigid_play
from pipeline.model.load_history.load_cycle import ARCMIN
from pipeline.model.units import NM_PER_NMM

TOUCHING = 1e-7
"""Room [mm] up to which a contact of the rigid pose touches."""
TENSION_START = 1e-4
"""Force [N] below which a held contact's law goes on along its tangent, so that it may pull in an FE analysis."""
FIRST_SHIFT = 1e-3
"""Displacement [mm] of the disk centre at which Newton's method starts: at none a bearing by Hertz has no stiffness."""
FIRST_TURN = 1e-4
"""Rotation [rad] of each body on the one before it, beyond the end of play, at which the direct procedure starts."""
BALANCE_TOLERANCE = 1e-10
"""Change of the forces, relative to the largest, at which Newton's method ends."""
NEWTON_STEPS, PASSES = 100, 200
"""Steps of one analysis, and analyses until the contacts settle; beyond them the procedure has failed."""
REPEATS = 5
"""A time is the best of so many."""


@dataclass(frozen=True)
class LoadCase:
    """One reducer under one output torque [N mm]; ``gap`` (n_contacts,) [mm], the bearing without clearance."""

    reducer: Reducer
    bearing: Bearing
    laws: ContactLaws
    compliance: Real
    gap: Real
    torque: float


@dataclass(frozen=True)
class Analysis:
    """Forces (n_contacts,) [N] and motions (n_motions,), with the passes and the linear systems that they took."""

    force: Real
    motion: Real
    passes: int
    systems: int


def iterative(load: LoadCase) -> Analysis:
    """Kinematics and FE in turn until the contacts settle.

    Raises
    ------
    ArithmeticError
        If they do not, or an FE analysis does not.
    """
    jacobian, gap = load.reducer.contact_jacobian, load.gap
    play = rigid_play(load.reducer, gap[None], np.zeros(1))
    motion = (play.pose_plus if load.torque > 0 else play.pose_minus)[0]
    contact_set = gap - jacobian @ motion <= TOUCHING
    systems = 0
    for turn in range(1, PASSES + 1):
        force, motion, steps = _held(load, np.flatnonzero(contact_set))
        systems += steps
        room = gap + load.compliance @ force - jacobian @ motion
        is_settled = np.where(contact_set, force > 0, room < 0)
        if np.array_equal(is_settled, contact_set):
            return Analysis(force, motion, turn, systems)
        contact_set = is_settled
    raise ArithmeticError(f"contacts unsettled after {PASSES} passes")


def direct(load: LoadCase) -> Analysis:
    """All contacts as springs with a dead zone, at one time."""
    play = rigid_play(load.reducer, load.gap[None], np.zeros(1))
    start = (play.pose_plus if load.torque > 0 else play.pose_minus).copy()
    rotations = [number for number, name in enumerate(load.reducer.motions) if name.endswith("_phi")]
    start[:, rotations] += np.sign(load.torque) * FIRST_TURN * np.arange(1, len(rotations) + 1)
    elastic = ElasticReducer(load.reducer, load.bearing, load.laws, load.compliance)
    states = solve(elastic, load.gap[None], np.zeros(1), start, np.array([load.torque]))
    return Analysis(states.force[0, 0], states.motion[0, 0], 1, int(states.iterations[0, 0]))


def _held(load: LoadCase, contacts: np.ndarray) -> tuple[Real, Real, int]:
    """FE analysis with ``contacts`` held closed: forces (n_contacts,), motions, and the linear systems solved."""
    jacobian, laws = load.reducer.contact_jacobian[contacts], load.laws[contacts]
    elastic = load.compliance[np.ix_(contacts, contacts)]
    n, n_motions = jacobian.shape
    applied_load = np.zeros(n_motions)
    applied_load[load.reducer.output_motion] = load.torque
    force, motion = np.full(n, TENSION_START), np.zeros(n_motions)
    motion[0] = FIRST_SHIFT
    for step in range(1, NEWTON_STEPS + 1):
        proper = np.maximum(force, TENSION_START)
        slope = laws.compliance(proper)
        local = laws.deflection(proper) + (force - proper) * slope
        push, spring = _bearing(load.bearing, motion)
        penetration = local + elastic @ force + load.gap[contacts] - jacobian @ motion
        balance = jacobian.T @ force + push - applied_load
        tangent = np.block([[elastic + np.diag(slope), -jacobian], [jacobian.T, spring]])
        change = np.linalg.solve(tangent, -np.concatenate([penetration, balance]))
        force, motion = force + change[:n], motion + change[n:]
        if np.max(np.abs(change[:n])) < BALANCE_TOLERANCE * np.max(np.abs(force)):
            forces = np.zeros(len(load.gap))
            forces[contacts] = force
            return forces, motion, step
    raise ArithmeticError(f"FE analysis with {n} contacts held not settled after {NEWTON_STEPS} steps")


def _bearing(bearing: Bearing, motion: Real) -> tuple[Real, Real]:
    """Force (n_motions,) of the bearing and its tangent (n_motions, n_motions)."""
    force, tangent = np.zeros(len(motion)), np.zeros((len(motion), len(motion)))
    distance = np.hypot(*motion[:2])
    direction = motion[:2] / distance
    secant = bearing.stiffness * distance ** (bearing.exponent - 1)
    force[:2] = secant * motion[:2]
    tangent[:2, :2] = secant * (np.eye(2) + (bearing.exponent - 1) * np.outer(direction, direction))
    return force, tangent


def procedures(study: Study, disk: Condensed, cases: SolvedCases) -> pd.DataFrame:
    """Both procedures for every case at the torques of the metrics: answers, passes, linear systems, seconds."""
    rows = []
    percents = (study.metrics.lost_motion_percent, *study.metrics.rigidity_percent)
    bearing, compliance = assembly.bearing(study.design), disk.compliance(study.design)
    for number, case in enumerate(study.cases):
        for percent in percents:
            torque = cases.cycle.rated_torque * percent / 100
            load = LoadCase(cases.reducer, bearing, cases.laws, compliance, cases.gap[number], torque)
            for name, analyse in (("direct", direct), ("iterative", iterative)):
                analysis, seconds = _timed_analysis(analyse, load)
                rows.append(
                    {
                        "case": case.label,
                        "torque_Nm": NM_PER_NMM * load.torque,
                        "procedure": name,
                        "angle_arcmin": ARCMIN * analysis.motion[cases.reducer.output_motion],
                        "pins_in_contact": int(np.count_nonzero(analysis.force[: cases.reducer.n_pins] > 0)),
                        "largest_force_N": float(np.max(analysis.force)),
                        "fe_analyses": analysis.passes,
                        "linear_systems": analysis.systems,
                        "seconds": seconds,
                    }
                )
    return pd.DataFrame(rows)


def _timed_analysis(analyse: Callable[[LoadCase], Analysis], load: LoadCase) -> tuple[Analysis, float]:
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        analysis = analyse(load)
        times.append(time.perf_counter() - start)
    return analysis, min(times)
