"""Check of several disks: equal shares of perfect ones, one part or two meshes, and what a phase error takes."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pipeline import assembly
from pipeline.arrays import Real
from pipeline.checks.specimen import Specimen
from pipeline.checks.verify.findings import Finding, largest_difference, relative
from pipeline.checks.verify.reducers.two_disks import (
    CRANK_DEG,
    SHARES,
    blocks_of_one_part,
    crude_study,
    joined_blocks,
    second_mesh,
)
from pipeline.config import Study
from pipeline.model.equilibrium.solve import Equilibria
from pipeline.model.geometry.clearance import Errors, gaps
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.geometry.rigid_play.rigid_backlash import general_play, separated_play
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.load_cycle import first_poses
from pipeline.model.units import MM_PER_UM
from pipeline.mounting import drive_of
from pipeline.sampling.errors import draw

STUDY = "two_disks"
EDGES_PER_LOBE = 24
"""Edges of the mesh on the flank of a lobe."""
PHASE_UM = 6.0
"""Way of one eccentric around the crank."""
TWO_MESHES = 0.02
"""Compliances of one part on two crude meshes, over the largest: their holes lie otherwise between the elements."""


def check_disks(specimen: Specimen) -> Iterator[Finding]:
    """Two perfect disks of one part carry half each and turn as one does under half; see ``STUDY``."""
    study = crude_study(STUDY, EDGES_PER_LOBE)
    one_disk = _with_disks(study, 1)
    blocks = blocks_of_one_part(study)
    two_disk_drive, single = _drive(study, blocks), _drive(one_disk, blocks[:1])
    for sense, name in ((1, "plus"), (-1, "minus")):
        torque = sense * two_disk_drive.rated_torque * SHARES
        states, of_one = _loaded_states(two_disk_drive, torque), _loaded_states(single, torque / 2)
        moments = states.force[0] * two_disk_drive.reducer.contact_jacobian[:, two_disk_drive.reducer.output_motion]
        share = moments[:, two_disk_drive.reducer.disk_of_contact == 0].sum(axis=1) / torque
        yield largest_difference(f"share of either perfect disk, torque {name}", 0.5, share, 1e-9)
        expected_rotation = of_one.motion[0, :, single.reducer.output_motion]
        output_angle = states.motion[0, :, two_disk_drive.reducer.output_motion]
        yield relative(
            f"rotation under T with two disks against T/2 with one, {name} [rad]", expected_rotation, output_angle, 1e-9
        )
    yield second_mesh(study, blocks[1], TWO_MESHES)
    yield from _phase(study)


def _with_disks(study: Study, count: int) -> Study:
    disk = study.design.disk.model_copy(update={"count": count})
    return study.model_copy(update={"design": study.design.model_copy(update={"disk": disk})})


def _drive(study: Study, blocks: list[Real]) -> Drive:
    reducer = assembly.reducer(study.design, CRANK_DEG)
    nominal = draw(study, 0, 1)
    clearance = assembly.bearing_clearance(study.design, nominal.bearing_clearance)
    return drive_of(study, CRANK_DEG, joined_blocks(reducer, blocks), assembly.errors(nominal), clearance)


def _loaded_states(drive: Drive, torque: Real) -> Equilibria:
    play = separated_play(drive.reducer, drive.gap)
    pose = play.pose_plus if torque[0] > 0 else play.pose_minus
    return drive.equilibria(first_poses(drive, pose, torque[0]), torque)


def _phase(study: Study) -> Iterator[Finding]:
    """Rigid play with one eccentric out of phase: the interval of its disk moves by s/(e lobes) off the other's."""
    reducer, cycloid = assembly.reducer(study.design, CRANK_DEG), study.design.cycloid
    errors = assembly.errors(draw(study, 0, 1))
    phase = np.array([[0.0, MM_PER_UM * PHASE_UM]])
    plays = [_play(study, reducer, case) for case in (errors, replace(errors, eccentric_phase=phase))]
    phase_turn = MM_PER_UM * PHASE_UM / (cycloid.eccentricity_mm * cycloid.lobes)
    yield relative("backlash that a phase error of one eccentric takes [rad]", phase_turn, plays[0] - plays[1], 1e-2)
    gap = gaps(assembly.profile(study.design), reducer, replace(errors, eccentric_phase=phase), **dict(study.clearance))
    program = general_play(reducer, gap, np.zeros(1)).backlash[0]
    yield relative("backlash with it, against HiGHS [rad]", program, plays[1], 1e-9)


def _play(study: Study, reducer: Reducer, errors: Errors) -> float:
    gap = gaps(assembly.profile(study.design), reducer, errors, **dict(study.clearance))
    return float(separated_play(reducer, gap).backlash[0])
