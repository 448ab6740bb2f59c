"""A linear program with centres in discs: the poses of rigid bodies whose disks have play in their bearings."""

from typing import NamedTuple

import numpy as np
import scipy  # its functions are slow to import: they are when they are called

from pipeline.arrays import Index, Real

CONE_TOLERANCE = 1e-9
"""The bearing's disc is cut until it is met to this share of the clearance."""
PROGRAM_TOLERANCE = 1e-10
"""Feasibility of the linear programs, which are solved in micrometres."""
AMONG_MANY = 20
"""Tangents of a bearing's disc after which its optimum is taken for one of many; a single one needs some 16."""
MOST_CUTS = 200
"""Tangents of a bearing's disc after which a program is given up."""


def _program(objective: Real, rows: Real, limits: Real, radii: Real) -> np.ndarray | None:
    """Maximise objective @ x subject to rows @ x <= limits and |x[2k]|, |x[2k+1]| <= radii[k]; None where infeasible.

    Raises
    ------
    ArithmeticError
        If the program is unbounded or the solver fails.
    """
    bounds: list[tuple[float | None, float | None]] = [(-radius, radius) for radius in np.repeat(radii, 2)]
    bounds += [(None, None)] * (len(objective) - len(bounds))
    options = {"primal_feasibility_tolerance": PROGRAM_TOLERANCE, "dual_feasibility_tolerance": PROGRAM_TOLERANCE}
    linear_program = scipy.optimize.linprog
    solution = linear_program(-objective, A_ub=rows, b_ub=limits, bounds=bounds, method="highs", options=options)
    if solution.status == 2:
        return None
    if solution.status != 0:
        raise ArithmeticError(f"rigid play not solved: {solution.message}")
    return np.asarray(solution.x)


class _Tangents(NamedTuple):
    """Tangents of the bearings' discs.

    Attributes
    ----------
    normals : (n_cuts, n_motions)
    radii : of their discs (n_cuts,) [um].
    of_disk : (n_cuts, n_disks) 1 where a disc is a tangent's.
    """

    normals: Real
    radii: Real
    of_disk: Real


def _overshooting(x: Real, radii: Real) -> Index:
    """Disks whose centre x[2k:2k+2] lies beyond the disc of its bearing and its tolerance."""
    reach = np.hypot(*x[: 2 * len(radii)].reshape(-1, 2).T)
    return np.flatnonzero(reach > radii * (1 + CONE_TOLERANCE) + PROGRAM_TOLERANCE)


def _with_tangents(tangents: _Tangents, x: Real, radii: Real, disks: Index) -> _Tangents:
    """The tangents and, of some discs, those in the direction of x[2k:2k+2]."""
    normals = np.zeros((len(disks), tangents.normals.shape[1]))
    for row, disk in zip(normals, disks, strict=True):
        centre = slice(2 * disk, 2 * disk + 2)
        row[centre] = x[centre] / np.hypot(*x[centre])
    of_disk = np.vstack([tangents.of_disk, np.eye(len(radii))[disks]])
    return _Tangents(np.vstack([tangents.normals, normals]), np.append(tangents.radii, radii[disks]), of_disk)


def cut_program(objective: Real, rows: Real, limits: Real, radii: Real) -> np.ndarray | None:
    """Maximise objective @ x subject to rows @ x <= limits and |x[2k:2k+2]| <= radii[k]; None where infeasible.

    Notes
    -----
    A disc is replaced by its tangents at the optima so far (Kelley, J. SIAM 8 (1960) 703). Each quarters the
    overshoot, unless the optimum is one of many: where the disk's centre decides nothing, every tangent only moves it
    on to the next corner of the polygon. After ``AMONG_MANY`` tangents the optimum nearest to the centre is asked for.

    Raises
    ------
    ArithmeticError
        If the program is unbounded, the solver fails or ``MOST_CUTS`` tangents are not enough.
    """
    tangents = _Tangents(np.zeros((0, len(objective))), np.zeros(0), np.zeros((0, len(radii))))
    while len(tangents.radii) < MOST_CUTS * max(len(radii), 1):
        bounded = np.append(limits, tangents.radii)
        optimum = _program(objective, np.vstack([rows, tangents.normals]), bounded, radii)
        if optimum is None:
            return None
        overshoot = _overshooting(optimum, radii)
        if not len(overshoot):
            return optimum
        tangents = _with_tangents(tangents, optimum, radii, overshoot)
        if len(tangents.radii) > AMONG_MANY * len(radii):
            optimal = np.vstack([rows, -objective]), np.append(limits, PROGRAM_TOLERANCE - objective @ optimum)
            nearest, tangents = _nearest_to_the_centres(*optimal, tangents, radii)
            if nearest is not None:
                return nearest
    raise ArithmeticError(f"rigid play not solved: {MOST_CUTS} tangents do not replace a bearing's clearance")


def _nearest_to_the_centres(
    rows: Real, limits: Real, tangents: _Tangents, radii: Real
) -> tuple[Real | None, _Tangents]:
    """Point of rows @ x <= limits with every x[2k:2k+2] in its disc, None where there is none; and all tangents used.

    The sum of the shares of their radii within which the centres lie, along the tangents' normals, is minimised: from
    below it tends to the least.
    """
    n, disks = rows.shape[1], len(radii)
    shares = np.append(np.zeros(n), -np.ones(disks))
    fixed = np.vstack([np.hstack([rows, np.zeros((len(rows), disks))]), np.eye(disks, n + disks, n) * -1.0])
    while len(tangents.radii) < MOST_CUTS * disks:
        measured = np.hstack([tangents.normals, -tangents.radii[:, None] * tangents.of_disk])
        bounds = np.concatenate([limits, np.zeros(disks + len(tangents.radii))])
        point = _program(shares, np.vstack([fixed, measured]), bounds, radii)
        if point is None or np.any((point[n:] - 1 - CONE_TOLERANCE) * radii > PROGRAM_TOLERANCE):
            break
        overshoot = _overshooting(point, radii)
        if not len(overshoot):
            return point[:n], tangents
        tangents = _with_tangents(tangents, point, radii, overshoot)
    return None, tangents
