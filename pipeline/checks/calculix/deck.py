"""Input deck of CalculiX for one sample of a study at one crank angle.

The disk is meshed with the study's own quadratic triangles. Everything else is springs and linear constraints:

- node A<i> of contact i, freedom 1: the penetration of the contact by the rigid and mean motions of its two bodies,
  held by *EQUATION to the pressure-weighted mean displacement of its patch and to the rotations of plate and output;
- a nonlinear spring between A<i> and the fixed node G<i>, 1000 mm ahead: no force up to the gap, the law's beyond;
- nodes of the rigid bodies: the bore's mean displacement on the bearing's spring, plate and output.

Pitfalls that this set-up avoids: without NLGEOM CalculiX solves silently with the first slope of a nonlinear spring;
with NLGEOM a spring turns with its nodes, hence the 1000 mm; its table of force against elongation ends in a constant
force, so it reaches beyond every load; rigid bodies with direct steps cycle for ever, hence equations and automatic
steps. Only closed contacts hold the disk, so the deck starts at rigid motions that close those of the first load; the
finite rotations that NLGEOM counts are then those by the loads, below a minute or two of arc.

Source: G. Dhondt, CalculiX CrunchiX User's Manual, version 2.20.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Real
from pipeline.checks.specimen import Specimen
from pipeline.errors import InputError
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.elastic.condensed_body import ElasticBody
from pipeline.model.elastic.polygon import cross
from pipeline.model.equilibrium.solve import Equilibria
from pipeline.model.geometry.cycloid_profile import disk_rotation
from pipeline.model.geometry.reducer import Bearing, Reducer

AHEAD = 1000.0
"""Distance of a spring's fixed node [mm]."""
SPAN = 10.0
"""Radius [mm] at which rotations of plate and output are displacements of their nodes."""
TABLE_POINTS = 180
"""Per spring where it carries load; CalculiX overwrites its own memory, and says nothing, beyond 200 in all."""
OVERSHOOT = 1e4
"""To which each table goes on, in forces of one contact that carries the whole torque: an iteration may go there."""
LEAST_SHARE = 1e-4
"""Of the largest force of a table, at its first point."""
BEARING_REACH = 10.0
"""Of the bearing's table [mm]."""
TERMS_A_LINE = 4
"""Terms of an equation on a line of the deck; the program reads no longer ones."""
NODES_A_LINE = 12
"""Nodes of a set on a line of the deck; the program reads at most 16."""
ELEMENTS = {"plane_stress": "CPS6", "plane_strain": "CPE6"}
REVERSED_ORDER = [0, 2, 1, 5, 4, 3]
"""Nodes of a quadratic triangle run round the other way."""
INCREMENT = {"first": 1.0, "least": 1e-6, "largest": 1.0}
"""Of a load step; CalculiX divides a step that does not converge."""


@dataclass(frozen=True)
class Deck:
    """Text of the deck, and how to read the answer.

    Attributes
    ----------
    text : the input file.
    springs : ground node of every contact (n_contacts,), whose reaction is the contact force.
    output_node : node whose displacement along 1 is ``SPAN`` times the output's rotation from ``first_angle``.
    first_angle : rotation of the output [rad] at the start of the deck.
    torque : (n_torques,) [N mm], one load step each.
    """

    text: str
    springs: np.ndarray
    output_node: int
    first_angle: float
    torque: Real


@dataclass(frozen=True)
class Numbers:
    """Numbers of the deck's nodes and elements behind those of the mesh."""

    mesh_nodes: int
    mesh_elements: int
    contacts: int

    def approach(self, contact: int) -> int:
        return self.mesh_nodes + 1 + contact

    def ground(self, contact: int) -> int:
        return self.mesh_nodes + self.contacts + 1 + contact

    def body(self, number: int) -> int:
        """Bore (0), plate (1), output (2), and the ground of the bearing's springs along x (3) and y (4)."""
        return self.mesh_nodes + 2 * self.contacts + 1 + number

    def spring(self, contact: int) -> int:
        return self.mesh_elements + 1 + contact


BODIES = ("disk", "plate", "output")


def calculix_deck(specimen: Specimen, torque: Real, states: Equilibria) -> Deck:
    """Deck of a sample at the output torques (n_torques,) [N mm] of one sense.

    It starts at the rigid motions of the first of the sample's own ``states`` at these torques.

    Raises
    ------
    InputError
        If the bearing is not a linear spring without clearance: CalculiX has no spring of the law K (d - c)^n for a
        displacement in the plane.
    """
    bearing, clearance = specimen.bearing, specimen.bearing_clearance
    if bearing.exponent != 1 or clearance > 0:
        raise InputError(
            f"bearing: exponent {bearing.exponent:g}, clearance {clearance:g} mm; CalculiX has only linear springs for "
            "a displacement in the plane; export a design with exponent 1 and clearance 0"
        )
    reducer, disk, start = specimen.reducer, specimen.disk, states.motion[0, 0]
    numbers = Numbers(len(disk.nodes), len(disk.triangles), len(reducer.contacts))
    centre = complex(start[0], start[1]) * np.exp(-1j * disk_rotation(specimen.profile, reducer.crank))  # in its frame
    largest_force = np.abs(torque).max() / np.abs(reducer.contacts.arm).max()
    sections = (
        _heading(specimen, torque),
        _mesh(disk),
        _bodies(reducer, numbers),
        _approaches(specimen, numbers),
        _bearing(bearing, disk, (centre.real, centre.imag), numbers),
        _springs(specimen.laws, specimen.gap - reducer.contact_jacobian @ start, largest_force, numbers),
        _steps(numbers, torque),
    )
    return Deck(
        "\n".join(line for section in sections for line in section) + "\n",
        np.array([numbers.ground(i) for i in range(numbers.contacts)]),
        numbers.body(2),
        float(start[reducer.output_motion]),
        torque,
    )


def _heading(specimen: Specimen, torque: Real) -> Iterator[str]:
    yield "*HEADING"
    yield f"study {specimen.study.name}, sample {specimen.sample}, crank {specimen.crank_deg:g} degrees"
    yield "** Units N, mm, MPa. Nodes: the disk's mesh, then A<i> and G<i> of the contacts, then bore, plate, output."
    yield f"** Output torques of the steps [N mm]: {', '.join(f'{load:.6g}' for load in torque)}"
    for i, label in enumerate(specimen.reducer.contacts.label):
        yield f"** contact {i}: {label}"


def _mesh(disk: ElasticBody) -> Iterator[str]:
    yield "*NODE, NSET=DISK"
    for i, node in enumerate(disk.nodes, start=1):
        yield f"{i}, {node.real:.12g}, {node.imag:.12g}, 0."
    yield f"*ELEMENT, TYPE={ELEMENTS[disk.stress]}, ELSET=DISK"
    a, b, c = disk.nodes[disk.triangles[:, :3]].T
    clockwise = cross(b - a, c - a) < 0  # CalculiX refuses them
    triangles = np.where(clockwise[:, None], disk.triangles[:, REVERSED_ORDER], disk.triangles)
    for i, nodes in enumerate(triangles + 1, start=1):
        yield f"{i}, " + ", ".join(map(str, nodes))
    yield "*MATERIAL, NAME=DISK"
    yield "*ELASTIC"
    yield f"{disk.youngs_modulus:.12g}, {disk.poisson_ratio:.12g}"
    yield "*SOLID SECTION, ELSET=DISK, MATERIAL=DISK"
    yield f"{disk.thickness:.12g}"


def _bodies(reducer: Reducer, numbers: Numbers) -> Iterator[str]:
    """Nodes of the contacts and of the bodies, and which of their freedoms move."""
    yield "*NODE"
    for i in range(numbers.contacts):
        yield f"{numbers.approach(i)}, 0., {i + 100}., 0."
        yield f"{numbers.ground(i)}, {AHEAD:g}, {i + 100}., 0."
    for k in range(len(BODIES)):
        yield f"{numbers.body(k)}, 0., {-100 - k}., 0."
    x, y = 0.0, -100.0
    yield f"{numbers.body(3)}, {x + AHEAD:g}, {y:g}, 0."
    yield f"{numbers.body(4)}, {x:g}, {y + AHEAD:g}, 0."
    yield "*NSET, NSET=GROUND"
    yield from _lines([str(numbers.ground(i)) for i in range(numbers.contacts)], NODES_A_LINE)
    yield "*NSET, NSET=OUTPUT"
    yield f"{numbers.body(2)}"
    yield "*BOUNDARY"
    for i in range(numbers.contacts):
        yield f"{numbers.approach(i)}, 2, 3"
        yield f"{numbers.ground(i)}, 1, 3"
    yield f"{numbers.body(0)}, 3, 3"
    yield f"{numbers.body(3)}, 1, 3"
    yield f"{numbers.body(4)}, 1, 3"
    for k, body in enumerate(BODIES[1:], start=1):
        free_components = [1] + [
            component for component, name in ((2, "x"), (3, "y")) if f"{body}_{name}" in reducer.motions
        ]
        for component in sorted({1, 2, 3} - set(free_components)):
            yield f"{numbers.body(k)}, {component}, {component}"


def _approaches(specimen: Specimen, numbers: Numbers) -> Iterator[str]:
    """Penetration of every contact: the patch's mean displacement against the load, and the other bodies' motion."""
    reducer, loads = specimen.reducer, specimen.disk.loads(specimen.patches)
    position = _freedom_places(specimen.disk)
    column = {int(contact): k for k, contact in enumerate(specimen.disk_rows)}
    for i in range(numbers.contacts):
        terms = [(numbers.approach(i), 1, -1.0)]
        if i in column:
            k = column[i]
            span = slice(loads.indptr[k], loads.indptr[k + 1])
            terms += [
                (*position[dof], -value) for dof, value in zip(loads.indices[span], loads.data[span], strict=True)
            ]
        for j, motion in enumerate(reducer.motions):
            body, component = motion.rsplit("_", 1)
            if body != "disk" and reducer.contact_jacobian[i, j] != 0:
                axis = {"phi": 1, "x": 2, "y": 3}[component]
                unit = SPAN if component == "phi" else 1.0
                terms.append((numbers.body(BODIES.index(body)), axis, reducer.contact_jacobian[i, j] / unit))
        yield from _equation(terms)


def _bearing(bearing: Bearing, disk: ElasticBody, start: tuple[float, float], numbers: Numbers) -> Iterator[str]:
    """The bore's mean displacement from ``start`` [mm], on a spring along each axis."""
    position = _freedom_places(disk)
    for axis in (0, 1):
        fit = disk.reference[:, axis]
        fit_nodes = np.flatnonzero(fit)
        yield from _equation(
            [(numbers.body(0), axis + 1, -1.0), *((*position[int(dof)], fit[dof]) for dof in fit_nodes)]
        )
        name = f"BEARING{axis + 1}"
        yield f"*ELEMENT, TYPE=SPRINGA, ELSET={name}"
        yield f"{numbers.spring(numbers.contacts + axis)}, {numbers.body(0)}, {numbers.body(3 + axis)}"
        yield f"*SPRING, ELSET={name}, NONLINEAR"
        for reach in (-BEARING_REACH, BEARING_REACH):
            yield f"{bearing.stiffness * (reach - start[axis]):.12g}, {reach:.12g}"


def _springs(laws: ContactLaws, gap: Real, largest_force: float, numbers: Numbers) -> Iterator[str]:
    """A nonlinear spring per contact: a table of force against elongation, both negative in compression."""
    dense, overshoot = np.geomspace(LEAST_SHARE, 1.0, TABLE_POINTS), np.geomspace(2.0, OVERSHOOT, 10)
    force = largest_force * np.concatenate([[0.0], dense, overshoot])
    deflection = laws.deflection(np.repeat(force[:, None], len(laws), axis=1))
    for i in range(numbers.contacts):
        yield f"*ELEMENT, TYPE=SPRINGA, ELSET=CONTACT{i}"
        yield f"{numbers.spring(i)}, {numbers.approach(i)}, {numbers.ground(i)}"
        yield f"*SPRING, ELSET=CONTACT{i}, NONLINEAR"
        for load, depth in zip(force[::-1], deflection[::-1, i], strict=True):
            yield f"{-load:.12g}, {-(gap[i] + depth):.12g}"
        yield f"0., {AHEAD:g}"


def _steps(numbers: Numbers, torque: Real) -> Iterator[str]:
    for load in torque:
        yield "*STEP, NLGEOM, INC=10000"
        yield "*STATIC"
        yield f"{INCREMENT['first']:g}, 1., {INCREMENT['least']:g}, {INCREMENT['largest']:g}"
        yield "*CLOAD"
        yield f"{numbers.body(2)}, 1, {load / SPAN:.12g}"
        yield "*NODE PRINT, NSET=GROUND, FREQUENCY=10000"
        yield "RF"
        yield "*NODE PRINT, NSET=OUTPUT, FREQUENCY=10000"
        yield "U"
        yield "*END STEP"


def _freedom_places(disk: ElasticBody) -> dict[int, tuple[int, int]]:
    """Node and direction of every freedom of the disk."""
    return {
        int(dof): (node, axis)
        for node, pair in enumerate(disk.freedoms, start=1)
        for axis, dof in enumerate(pair, start=1)
    }


def _equation(terms: list[tuple[int, int, float]]) -> Iterator[str]:
    """A linear constraint; the first term is the one that is eliminated."""
    yield "*EQUATION"
    yield str(len(terms))
    yield from _lines([f"{node}, {axis}, {factor:.12g}" for node, axis, factor in terms], TERMS_A_LINE)


def _lines(words: Iterable[str], per_line: int) -> Iterator[str]:
    words = list(words)
    for start in range(0, len(words), per_line):
        yield ", ".join(words[start : start + per_line])
