"""A disk under pressure on small patches, whole in CalculiX: linear, held by its bore, on a mesh of its own.

Nothing of the model's mesh, patches, loads or factorisation is used. Pressures are integrated along the curved edges;
the reaction is spread evenly over the bore, and displacements are counted from the bore's mean motion, both by
Simpson's rule, exact for the quadratic edges of a circle evenly divided.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from pipeline.arrays import Complex, Real
from pipeline.checks.calculix.program import execute, printed_blocks
from pipeline.checks.calculix.quadtree_mesh import Curve, CurvedMesh, Loop

PRESSURE_POINTS = 400
"""Of a patch: its pressure by the midpoint rule in the angle t, x = w sin t, where the rule is exact."""
DENSE = 10_000
"""Points of a boundary between which that coordinate is interpolated: chords of some 0.04 mm on a disk of 70 mm."""
REACH = 1.5
"""Half widths about a patch within which its boundary is searched, and does not turn back."""
SIMPSON = np.array([1, 4, 1]) / 6
"""Shares of a quadratic edge's ends and middle in its length."""
NAME = "disk"


@dataclass(frozen=True)
class Press:
    """A unit force by an elliptical pressure over the half width ``half_width`` [mm] across its direction.

    Attributes
    ----------
    boundary : number of the boundary, the outer one 0.
    point, direction : where [mm] and along which unit vector it pushes the disk, complex.
    """

    boundary: int
    point: complex
    direction: complex
    half_width: float


@dataclass(frozen=True)
class PressedDisk:
    """The disk in plane strain.

    Attributes
    ----------
    mesh, curves : with the boundaries in one order, the bore the last one, evenly divided.
    youngs_modulus, poisson_ratio, thickness : [MPa], [-], [mm].
    presses : the patches.
    """

    mesh: CurvedMesh
    curves: tuple[Curve, ...]
    youngs_modulus: float
    poisson_ratio: float
    thickness: float
    presses: tuple[Press, ...]

    @cached_property
    def shares(self) -> list[tuple[np.ndarray, Real]]:
        """Nodes of every patch and their shares of its force, which sum to 1."""
        return [self._share(press) for press in self.presses]

    def _share(self, press: Press) -> tuple[np.ndarray, Real]:
        curve, loop = self.curves[press.boundary], self.mesh.loops[press.boundary]
        angle = np.pi * ((np.arange(PRESSURE_POINTS) + 0.5) / PRESSURE_POINTS - 0.5)
        weight = 2 / PRESSURE_POINTS * np.cos(angle) ** 2
        parameter = _parameters(curve, press, press.half_width * np.sin(angle))
        edge = np.searchsorted(loop.parameter, parameter, side="right") - 1
        ends = np.append(loop.parameter, 1.0)
        part = (parameter - ends[edge]) / (ends[edge + 1] - ends[edge])
        shape = np.stack([(1 - part) * (1 - 2 * part), 4 * part * (1 - part), part * (2 * part - 1)])
        nodes = np.stack([loop.corner[edge], loop.middle[edge], np.roll(loop.corner, -1)[edge]])
        number, node_index = np.unique(nodes, return_inverse=True)
        return number, np.asarray(np.bincount(node_index.ravel(), (shape * weight).ravel()), float)

    @cached_property
    def bore(self) -> tuple[np.ndarray, Real]:
        """Nodes of the bore and their shares of its length."""
        return ring(self.mesh.loops[-1])

    def loads(self, forces: Real) -> Complex:
        """Force on every node (n_nodes,) complex [N] by forces (n_presses,) on the patches, the bore's reaction too."""
        load = np.zeros(len(self.mesh.nodes), complex)
        for force, press, (nodes, share) in zip(forces, self.presses, self.shares, strict=True):
            load[nodes] += force * share * press.direction
        nodes, share = self.bore
        arm = self.mesh.nodes[nodes]
        moment = np.sum(np.imag(np.conj(self.mesh.nodes) * load))
        load[nodes] -= share * (load.sum() + moment * 1j * arm / np.abs(arm) ** 2)
        return load

    def solve(self, forces: Real, folder: Path) -> Complex:
        """Displacements (n_cases, n_nodes) complex [mm] from the bore's mean motion by forces (n_cases, n_presses).

        Nodes that are on no boundary are left zero.
        """
        execute("\n".join(self._deck(forces)) + "\n", len(forces), NAME, folder)
        blocks = printed_blocks(folder / f"{NAME}.dat")["displacements"]
        displacement: Complex = np.zeros((len(blocks), len(self.mesh.nodes)), complex)
        for case, values in enumerate(blocks):
            nodes = np.array(list(values)) - 1
            displacement[case, nodes] = [complex(x, y) for x, y, _ in values.values()]
        nodes, share = self.bore
        arm = self.mesh.nodes[nodes]
        shift = displacement[:, nodes] @ share
        turn = np.imag(np.conj(arm) * displacement[:, nodes] / np.abs(arm) ** 2) @ share
        held: Complex = displacement - shift[:, None] - 1j * turn[:, None] * self.mesh.nodes
        return held

    def along(self, displacement: Complex) -> Real:
        """Mean displacement of every patch along its force (n_cases, n_presses) [mm]."""
        pairs = zip(self.presses, self.shares, strict=True)
        return np.stack(
            [np.real(displacement[:, nodes] @ share * np.conj(press.direction)) for press, (nodes, share) in pairs],
            axis=1,
        )

    def _deck(self, forces: Real) -> Iterator[str]:
        yield "*NODE, NSET=ALL"
        for i, node in enumerate(self.mesh.nodes, start=1):
            yield f"{i}, {node.real:.12g}, {node.imag:.12g}, 0."
        yield "*ELEMENT, TYPE=CPE6, ELSET=DISK"
        for i, triangle in enumerate(self.mesh.triangles + 1, start=1):
            yield f"{i}, " + ", ".join(map(str, triangle))
        yield "*NSET, NSET=BOUNDARIES"
        for loop in self.mesh.loops:
            yield from (f"{node + 1}," for node in (*loop.corner, *loop.middle))
        yield "*MATERIAL, NAME=DISK"
        yield "*ELASTIC"
        yield f"{self.youngs_modulus:.12g}, {self.poisson_ratio:.12g}"
        yield "*SOLID SECTION, ELSET=DISK, MATERIAL=DISK"
        yield f"{self.thickness:.12g}"
        outer = self.mesh.nodes[self.mesh.loops[0].corner]
        clamped_node, slide_node = int(np.argmax(outer.real)) + 1, int(np.argmin(outer.real)) + 1  # they carry nothing
        yield "*BOUNDARY"
        yield f"{clamped_node}, 1, 2"
        yield f"{slide_node}, 2, 2"
        for case in forces:
            yield "*STEP"
            yield "*STATIC"
            yield "*CLOAD, OP=NEW"
            load = self.loads(case)
            for node in np.flatnonzero(load):
                yield f"{node + 1}, 1, {load[node].real:.12g}"
                yield f"{node + 1}, 2, {load[node].imag:.12g}"
            yield "*NODE PRINT, NSET=BOUNDARIES"
            yield "U"
            yield "*END STEP"


def ring(loop: Loop) -> tuple[np.ndarray, Real]:
    """Nodes of a circle evenly divided, and their shares of its length (n,)."""
    nodes = np.concatenate([loop.corner, loop.middle])
    count = len(loop.corner)
    return nodes, np.repeat([SIMPSON[0] + SIMPSON[2], SIMPSON[1]], count) / count


def _parameters(curve: Curve, press: Press, transverse: Real) -> Real:
    """Parameters at which the coordinate across the force, from the patch's point, is ``transverse`` (n,) [mm]."""
    parameter, points = curve.samples(DENSE)
    distance = np.abs(points - press.point)
    foot: float = parameter[np.argmin(distance)]
    is_pressed = distance < REACH * press.half_width
    offset = (parameter[is_pressed] - foot + 0.5) % 1.0 - 0.5
    tangential = np.real((points[is_pressed] - press.point) * np.conj(1j * press.direction))
    order = np.argsort(tangential)
    return (foot + np.interp(transverse, tangential[order], offset[order])) % 1.0
