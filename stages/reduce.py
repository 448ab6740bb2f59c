"""Stage 4a: the elastic disk condensed to the patches of its contacts, once per crank angle, before any sample."""

import json
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline import assembly
from pipeline.arrays import joined_columns
from pipeline.config.studies.study import Study
from pipeline.engine.stage import Job, Stage, Tables
from pipeline.engine.table import Column, Table
from pipeline.errors import InputError
from pipeline.model.geometry.contacts import PIN
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.units import UM_PER_MM
from stages.tables.condensed import COMPLIANCE_FILE, matrix_name
from stages.tables.keys import CONTACT, CRANK

if TYPE_CHECKING:
    from pipeline.model.elastic.condensed_body import ElasticBody

MESH_FILE, PARAVIEW_FILE = "mesh.npz", "mesh.vtu"
SECTIONS = ("design.cycloid", "design.materials", "design.disk", "design.flank", "design.output", "reduce")

CONTACTS = Table(
    "contacts",
    "row of the matrix, crank, disk",
    (
        Column("row", "int32", "1", "row and column of the disk's compliance matrix at this crank angle"),
        CONTACT,
        CRANK,
        Column("disk", "int32", "1", "disk whose matrix it is"),
        Column("patch_half_width_mm", "float64", "mm", "half width of the elliptical pressure on the mesh"),
        Column(
            "compliance_um_per_N", "float64", "um/N", "diagonal entry: mean elastic deflection of the patch per force"
        ),
    ),
)


def _write_mesh(study: Study, disk: "ElasticBody", reducer: Reducer, folder: Path) -> None:
    """Mesh, patches and the displacement by 1 N on the pin of the longest arm, for the picture and for ParaView."""
    from pipeline import elastic
    from pipeline.figures.mesh import write_vtk

    patches = elastic.disk_patches(study, disk, reducer)
    pin = int(np.argmax(np.abs(reducer.disks[0].pins.arm)))
    displacement = UM_PER_MM * disk.nodal_displacement(patches, np.eye(len(patches))[pin])
    fields = {f"displacement_um_per_N_on_pin_{pin}": displacement}
    with suppress(InputError):  # without meshio there is no file for ParaView
        write_vtk(folder / PARAVIEW_FILE, disk.nodes, disk.triangles, fields)
    np.savez(
        folder / MESH_FILE,
        nodes=disk.nodes,
        triangles=disk.triangles,
        patch_points=patches.points,
        hole_points=patches.points[reducer.contacts.hole[assembly.disk_contacts(reducer)] >= 0],
        displacement=displacement,
    )


class DiskMatrices:
    """Compliance of the elastic disks of a study at any crank angle, condensed once for equal settings and sources."""

    def __init__(self, job: Job, of_study: Study | None = None) -> None:
        study: Study = of_study or job.study
        self.job, self.study = job, study
        self.bodies: dict[float, ElasticBody] = {}
        sections = {
            "cycloid": study.design.cycloid.model_dump(mode="json"),
            "disk": study.design.disk.model_dump(mode="json", exclude={"count", "clocking"}),
            "material": study.design.materials[study.design.disk.material].model_dump(mode="json"),
            "output": study.design.output.model_dump(mode="json"),
            "reduce": study.reduce.model_dump(mode="json"),
        }
        self.settings = json.dumps(sections, sort_keys=True)

    def body(self, rotation: float = 0.0) -> "ElasticBody":
        """The meshed disk, its holes turned by ``rotation`` [rad]."""
        from pipeline import elastic  # slow to import, and few runs mesh

        if rotation not in self.bodies:
            self.bodies[rotation] = elastic.elastic_disk(self.study, rotation)
        return self.bodies[rotation]

    def at_crank(self, crank_deg: float) -> list[np.ndarray]:
        """Of each disk between its contacts (n_rows, n_rows) [um/N]."""
        matrices, design = [], self.study.design
        for number, clocking in enumerate(assembly.clockings(design)):
            part = assembly.first_part(design, crank_deg, number)
            if part is None:
                reducer = assembly.reducer(design, crank_deg)
                key = f"crank {crank_deg:.9g} disk {number}"
                matrices.append(self._condensed_disk(reducer, number, clocking.hole_rotation, key))
                continue
            turned_on, places = part
            reducer = assembly.reducer(design, turned_on)
            matrices.append(self._condensed_disk(reducer, 0, 0.0, f"crank {turned_on:.9g}")[np.ix_(places, places)])
        return matrices

    def _condensed_disk(self, reducer: Reducer, number: int, rotation: float, key: str) -> np.ndarray:
        def condense(folder: Path) -> None:
            from pipeline import elastic

            patches = elastic.disk_patches(self.study, self.body(rotation), reducer, number)
            np.save(folder / "matrix.npy", UM_PER_MM * self.body(rotation).compliance(patches).matrix)

        matrix: np.ndarray = np.load(self.job.memo(f"{self.settings} {key}", condense) / "matrix.npy")
        return matrix


def _run(job: Job) -> Tables:
    study: Study = job.study
    reducers = {crank: assembly.reducer(study.design, crank) for crank in study.cycle.crank_deg}
    matrices = _no_compliance(reducers) if study.reduce.disk == "rigid" else _compliance(job, reducers)
    np.savez(job.path(COMPLIANCE_FILE), **matrices)
    return {"contacts": _contact_rows(study, reducers, matrices)}


def _compliance(job: Job, reducers: dict[float, Reducer]) -> dict[str, Any]:
    """Matrices of the elastic disks at each crank angle by their names; the mesh is drawn beside them."""
    disks, first_reducer = DiskMatrices(job), next(iter(reducers.values()))
    matrices = {
        matrix_name(crank, number): matrix for crank in reducers for number, matrix in enumerate(disks.at_crank(crank))
    }
    drawn_disk = job.memo(
        f"{disks.settings} mesh at {first_reducer.crank:.9g}",
        lambda folder: _write_mesh(disks.study, disks.body(), first_reducer, folder),
    )
    for file in drawn_disk.glob("mesh.*"):
        job.path(file.name).write_bytes(file.read_bytes())
    return matrices


def _no_compliance(reducers: dict[float, Reducer]) -> dict[str, Any]:
    """The same of rigid disks, which have no mesh to draw."""
    matrices = {}
    for crank, reducer in reducers.items():
        for disk in range(reducer.n_disks):
            size = len(assembly.disk_contacts(reducer, disk))
            matrices[matrix_name(crank, disk)] = np.zeros((size, size))
    return matrices


def _contact_rows(
    study: Study, reducers: dict[float, Reducer], matrices: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    width = {PIN: study.reduce.patch_half_width_mm}
    parts = []
    for crank, reducer in reducers.items():
        for disk in range(reducer.n_disks):
            contact = assembly.disk_contacts(reducer, disk)
            widths = [
                width.get(kind, study.reduce.roller_patch_half_width_mm) for kind in reducer.contacts.kind[contact]
            ]
            parts.append(
                {
                    "row": np.arange(len(contact)),
                    "contact": contact,
                    "crank_deg": np.full(len(contact), crank),
                    "disk": np.full(len(contact), disk),
                    "patch_half_width_mm": np.array(widths),
                    "compliance_um_per_N": np.diag(matrices[matrix_name(crank, disk)]).copy(),
                }
            )
    return joined_columns(parts)


REDUCE = Stage(
    name="reduce",
    reads=(),
    sections=(*SECTIONS, "cycle.crank_deg"),
    tables=(CONTACTS,),
    module="stages.reduce",
    run=_run,
)
