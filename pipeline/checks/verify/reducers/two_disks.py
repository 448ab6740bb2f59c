"""Two disks on crude meshes, as the checks of several disks and of RV reducers solve them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline import assembly, elastic
from pipeline.arrays import Real
from pipeline.checks.verify.findings import Finding, largest_difference
from pipeline.config import Study, load_study
from pipeline.model.geometry.reducer import Reducer

ROOT = Path(__file__).parents[4]
CRANK_DEG = 25.0
"""Off the symmetries of pins, holes and cranks."""
CRUDE = {"patch_half_width_mm": 0.9, "growth": 0.8, "largest_edge_mm": 6.0}
"""A mesh for symmetry, which holds on any."""
SHARES = np.array([0.03, 0.3, 1.0])
"""Of the rated torque, at which the disks are compared."""


def crude_study(name: str, edges_per_lobe: int) -> Study:
    """A study of the project on a crude mesh."""
    study = load_study(name, ROOT)
    mesh = CRUDE | {"flank_edges_per_lobe": edges_per_lobe}
    return study.model_copy(update={"reduce": study.reduce.model_copy(update=mesh)})


def blocks_of_one_part(study: Study) -> list[Real]:
    """Compliance of either disk between its own contacts [mm/N], both of the first one's mesh turned on by lobes."""
    body, blocks = elastic.elastic_disk(study), []
    for disk in (0, 1):
        part = assembly.first_part(study.design, CRANK_DEG, disk)
        assert part is not None
        turned_on, places = part
        patches = elastic.disk_patches(study, body, assembly.reducer(study.design, turned_on))
        blocks.append(body.compliance(patches).matrix[np.ix_(places, places)])
    return blocks


def joined_blocks(reducer: Reducer, blocks: Sequence[Real]) -> Real:
    """Compliance (n_contacts, n_contacts) [mm/N] of all disks from that of each between its own contacts."""
    full = np.zeros((len(reducer.contacts), len(reducer.contacts)))
    for disk, block in enumerate(blocks):
        rows = assembly.disk_contacts(reducer, disk)
        full[np.ix_(rows, rows)] = block
    return full


def second_mesh(study: Study, as_one_part: Real, limit: float) -> Finding:
    """The second disk meshed with holes of its own, in the frame of its lobes."""
    clocking, reducer = assembly.clockings(study.design)[1], assembly.reducer(study.design, CRANK_DEG)
    body = elastic.elastic_disk(study, clocking.hole_rotation)
    own_mesh = body.compliance(elastic.disk_patches(study, body, reducer, 1)).matrix
    quantity = "compliance of the second disk on a mesh of its own, over the largest"
    return largest_difference(quantity, own_mesh, as_one_part, limit, np.max(own_mesh))
