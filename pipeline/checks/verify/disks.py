"""Check of several disks: equal shares of perfect ones, one part or two meshes, and what a phase error takes.

Meshes are crude, as in the check of RV reducers.

Check of a turn: no error of a perfect rigid reducer, that of one displaced pin, and a disk turned by its lobes.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pipeline import assembly, elastic
from pipeline.arrays import Real
from pipeline.checks.specimen import Finding, Specimen, largest_difference, relative, vanishing
from pipeline.config import Study, load_study
from pipeline.model.equilibrium.solve import Equilibria
from pipeline.model.geometry.clearance import Errors, gaps
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.geometry.rigid_play.rigid_backlash import general_play, separated_play
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.load_cycle import first_poses
from pipeline.model.units import MM_PER_UM
from pipeline.mounting import drive_of
from pipeline.populations.output_turn import PHASES
from pipeline.populations.turn_drives import places, turned_blocks
from pipeline.sampling.errors import draw
from pipeline.settings import PROJECT

CRANK_DEG = 25.0
"""Off the symmetries of pins, holes and cranks."""
CRUDE = {"patch_half_width_mm": 0.9, "growth": 0.8, "largest_edge_mm": 6.0}
"""A mesh for symmetry, which holds on any."""
SHARES = np.array([0.03, 0.3, 1.0])
"""Of the rated torque, at which the disks are compared."""


def crude_study(name: str, edges_per_lobe: int) -> Study:
    """A study of the project on a crude mesh."""
    study = load_study(name, PROJECT)
    return study.with_section("reduce", **CRUDE | {"flank_edges_per_lobe": edges_per_lobe})


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


def second_mesh(study: Study, as_one_part: Real, limit: float) -> Finding:
    """The second disk meshed with holes of its own, in the frame of its lobes."""
    clocking, reducer = assembly.clockings(study.design)[1], assembly.reducer(study.design, CRANK_DEG)
    body = elastic.elastic_disk(study, clocking.hole_rotation)
    own_mesh = body.compliance(elastic.disk_patches(study, body, reducer, 1)).matrix
    quantity = "compliance of the second disk on a mesh of its own, over the largest"
    return largest_difference(quantity, own_mesh, as_one_part, limit, np.max(own_mesh))


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
    one_disk = study.model_copy(update={"design": study.design.with_section("disk", count=1)})
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


def _drive(study: Study, blocks: list[Real]) -> Drive:
    reducer = assembly.reducer(study.design, CRANK_DEG)
    nominal = draw(study, 0, 1)
    clearance = assembly.bearing_clearance(study.design, nominal.bearing_clearance)
    return drive_of(study, CRANK_DEG, assembly.joined_blocks(reducer, blocks), assembly.errors(nominal), clearance)


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


CRANKS_DEG = 360.0 * np.arange(23) / 23
"""Crank angles [deg], coprime to the usual numbers of pins."""
GAP, INWARDS, DISPLACED_PIN = 8e-3, 5e-3, 3
"""Uniform gap and way of one pin towards the axis [mm], and its number."""
TURNS = (1, 37, 4001)
"""Pitches of the pins after which the turned disk is condensed afresh."""


def check_turn(specimen: Specimen) -> Iterator[Finding]:
    """A turn: rigid bodies without gaps, one displaced pin in closed form, lobe after lobe by symmetry."""
    perfect, displaced_ends, expected_ends = [], [], []
    for crank in CRANKS_DEG:
        perfect.append(_ends(specimen, crank, 0.0, 0.0, "exact"))
        displaced_ends.append(_ends(specimen, crank, GAP, INWARDS, "first_order"))
        expected_ends.append(_closed_form(specimen, np.radians(crank)))
    yield vanishing("transmission error of rigid bodies without gaps [rad]", np.array(perfect), 1e-9)
    quantity = "ends of the play with one displaced pin, over the largest, against the first-order form"
    yield largest_difference(
        quantity, np.array(expected_ends), np.array(displaced_ends), 1e-9, np.max(np.abs(expected_ends))
    )
    errors = [np.ptp(values, axis=0).max() for values in (np.array(expected_ends), np.array(displaced_ends))]
    yield relative("peak to peak of the transmission error by that pin [rad]", errors[0], errors[1], 1e-9)
    yield _by_symmetry(specimen)


def _ends(specimen: Specimen, crank_deg: float, gap: float, inwards: float, method: str) -> Real:
    """Ends (2,) of the disk's rotation among its pins [rad]: uniform material off the flank, one pin inwards [mm]."""
    reducer, profile = assembly.reducer(specimen.study.design, crank_deg), specimen.profile
    sampled_errors = vars(assembly.errors(draw(specimen.study, specimen.sample, specimen.sample + 1)))
    perfect = Errors(**{name: np.zeros_like(values) for name, values in sampled_errors.items()})
    radial = np.where(np.arange(profile.pins) == DISPLACED_PIN, -inwards, 0.0)[None]
    errors = replace(perfect, pin_radial=radial, lobe=np.full((1, profile.lobes), gap))
    readings = {"disk_reading": "normal", "roller_reading": specimen.study.clearance.roller_reading}
    return separated_play(reducer, gaps(profile, reducer, errors, method=method, **readings)).ends[:, 0]


def _closed_form(specimen: Specimen, crank: float) -> Real:
    """The disk turns until the first of gap/arm, with the displaced pin's gap less its approach along the normal.

    Source: arms e Z sin(phi)/S and normals (1 - K cos phi)/S of the pins at phi from the eccentric.
    """
    profile = specimen.profile
    k, phi = profile.shortening, profile.pin_angle() - crank
    s = np.sqrt(1 + k * k - 2 * k * np.cos(phi))
    arm, room = profile.eccentricity * profile.lobes * np.sin(phi) / s, np.full(profile.pins, GAP)
    room[DISPLACED_PIN] -= INWARDS * (1 - k * np.cos(phi[DISPLACED_PIN])) / s[DISPLACED_PIN]
    rotation_to_contact = room / np.maximum(np.abs(arm), 1e-12)
    return np.array([np.min(rotation_to_contact[arm > 0]), -np.min(rotation_to_contact[arm < 0])])


def _by_symmetry(specimen: Specimen) -> Finding:
    """The disk condensed once, its pins some pitches on, against a condensation at that crank angle."""
    study, phase = specimen.study, 1
    body, pins = specimen.disk, specimen.profile.pins
    blocks, differences = turned_blocks(study, body, 360.0 * phase / (PHASES * pins)), []
    for pitches in TURNS:
        reducer = assembly.reducer(study.design, 360.0 * (phase / PHASES + pitches) / pins)
        rows = assembly.disk_contacts(reducer)
        fresh = body.compliance(elastic.disk_patches(study, body, reducer)).matrix
        order = places(study, len(reducer.contacts), pitches)[rows]
        by_symmetry = blocks[pitches % len(blocks)][np.ix_(order, order)]
        differences.append(np.abs(by_symmetry - fresh).max() / np.abs(fresh).max())
    return vanishing("compliance after some pitches by symmetry, off a fresh one, over the largest", differences, 1e-8)
