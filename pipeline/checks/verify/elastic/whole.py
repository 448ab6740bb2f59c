"""Check of the condensation: the same mesh solved whole, with its nonlinear springs, in scikit-fem and in CalculiX."""

import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.checks.calculix import INSTALL, PROGRAM, ProgramResult, calculix_deck, calculix_program, run_calculix
from pipeline.checks.specimen import SHARES, Specimen, loaded_equilibria
from pipeline.checks.verify.elastic.unreduced import WholeSolution, solve_unreduced, whole_system
from pipeline.checks.verify.findings import Finding, largest_difference, relative, reported_number, skipped_check
from pipeline.config import load_study
from pipeline.engine.progress import Meter
from pipeline.model.equilibrium.solve import Equilibria
from pipeline.model.geometry.reducer import Reducer

ANGLE_LIMIT = 5e-3
"""Share by which the angle of an independent solver may differ: its mesh is not ours."""
FORCE_LIMIT = 1e-2
"""Share of the largest force by which a contact force may differ."""
ALGEBRA_LIMIT = 1e-6
"""Of the condensation alone, every arm that of the mesh's polygon."""
PLANE_STRAIN_LIMIT = 1e-4
"""Of CalculiX in plane strain, whose finite rotations and tables of springs differ from ours."""
COARSE_STUDY = "quick"
"""Study whose mesh CalculiX solves, whatever the mesh of the other checks."""
ROOT = Path(__file__).parents[4]
GIB = 2.0**30
"""Bytes of a gibibyte."""


def on_mesh(specimen: Specimen) -> Reducer:
    """The reducer with the arms that the patches have on the mesh's polygon, within its distance from the flank."""
    reducer, rows = specimen.reducer, specimen.disk_rows
    jacobian = reducer.contact_jacobian.copy()
    resultant = specimen.disk.loads(specimen.patches).T @ specimen.disk.rigid_motions
    jacobian[rows, reducer.motions.index("disk_phi")] = -resultant[:, 2]
    return replace(reducer, contact_jacobian=jacobian)


def _agreement(
    name: str, angle: np.ndarray, force: np.ndarray, solution: Equilibria, output: int, limits: tuple[float, float]
) -> Iterator[Finding]:
    """Angle, and forces as a share of the largest, of another solution (n_torques,), (n_torques, n_contacts)."""
    largest_force = force.max(axis=1, keepdims=True)
    yield relative(f"output angle, {name} [rad]", angle, solution.motion[0, :, output], limits[0])
    yield largest_difference(
        f"contact forces, {name}, over the largest [N]", force, solution.force[0], limits[1], largest_force
    )


def _cost(name: str, seconds: float, peak_bytes: float) -> Iterator[Finding]:
    yield reported_number(f"{name}: time [s]", seconds)
    yield reported_number(f"{name}: peak memory [GiB]", peak_bytes / GIB)


def check_unreduced(specimen: Specimen) -> Iterator[Finding]:
    """Whole reducer in scikit-fem: every freedom of the same mesh, nonlinear springs on the patch means, 5 loads."""
    torque = SHARES * specimen.rated_torque
    output = specimen.reducer.output_motion
    with Meter() as condensing:
        loaded_equilibria(specimen, torque)
        condensed_in = condensing.seconds
    start = time.perf_counter()
    condensed_states = loaded_equilibria(specimen, torque)  # the disk is condensed and the solver compiled by now
    solved_in = time.perf_counter() - start
    with Meter() as meter:
        solution: WholeSolution = solve_unreduced(specimen, whole_system(specimen), torque)
        whole_in = meter.seconds
    yield from _agreement(
        "unreduced", solution.angle, solution.force, condensed_states, output, (ANGLE_LIMIT, FORCE_LIMIT)
    )
    same_arms = loaded_equilibria(specimen, torque, reducer=on_mesh(specimen))
    name = "unreduced, arms of the mesh"
    yield from _agreement(name, solution.angle, solution.force, same_arms, output, (ALGEBRA_LIMIT, ALGEBRA_LIMIT))
    yield reported_number("freedoms of the whole system", specimen.disk.freedoms.size)
    yield reported_number("Newton steps of the whole system, 5 loads", float(solution.iterations.sum()))
    yield from _cost("condensation and 5 loads", condensed_in, condensing.peak_bytes)
    yield reported_number("5 loads, condensed: time [s]", solved_in)
    yield from _cost("5 loads, unreduced", whole_in, meter.peak_bytes)


def check_calculix(specimen: Specimen) -> Iterator[Finding]:
    """Whole reducer in CalculiX, coarse mesh: plane strain, 3 loads; then the gap of expanded elements in plane stress.

    Both solve one mesh, so a coarse one serves: on the paper's CalculiX takes the better part of an hour.
    """
    if calculix_program() is None:
        yield skipped_check(f"needs CalculiX: no program {PROGRAM}; {INSTALL}")
        return
    coarse = specimen.meshed_as(load_study(COARSE_STUDY, ROOT).reduce)
    output = coarse.reducer.output_motion
    for stress, shares in (("plane_strain", SHARES[::2]), ("plane_stress", SHARES[-1:])):
        torque = shares * coarse.rated_torque
        bodies = coarse if coarse.study.design.disk.stress == stress else coarse.in_stress(stress)
        solution = loaded_equilibria(bodies, torque)
        with tempfile.TemporaryDirectory() as folder:
            answer: ProgramResult = run_calculix(calculix_deck(bodies, torque, solution), Path(folder))
        if stress == "plane_strain":
            limits = (PLANE_STRAIN_LIMIT, PLANE_STRAIN_LIMIT)
            yield from _agreement("CalculiX in plane strain", answer.angle, answer.force, solution, output, limits)
            yield reported_number("iterations of CalculiX, 3 loads", float(answer.iterations))
            yield from _cost("3 loads, CalculiX", answer.seconds, answer.peak_bytes)
        else:
            yield reported_number(
                "output angle at the rated torque, CalculiX's plane stress beside ours [rad]",
                float(solution.motion[0, -1, output]),
                float(answer.angle[-1]),
            )
            gap = np.abs(solution.motion[0, :, output] / answer.angle - 1).max()
            yield reported_number(
                "gap of CalculiX's expanded elements in plane stress, output angle, relative", float(gap)
            )
