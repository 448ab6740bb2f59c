"""Check of an RV reducer with two disks: ratio, loads of the crank bearings, and what the first stage gives way."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, cast

import numpy as np

from pipeline import assembly
from pipeline.arrays import Complex, Real
from pipeline.checks.specimen import Finding, Specimen, largest_difference, relative
from pipeline.checks.verify.disks import CRANK_DEG, SHARES, blocks_of_one_part, crude_study, second_mesh
from pipeline.config import Study
from pipeline.config.mechanisms.carrier import Carrier
from pipeline.model.equilibrium.solve import Equilibria
from pipeline.model.geometry.contacts import OUTPUT, PIN
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.geometry.rigid_play.rigid_backlash import general_play
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.load_cycle import first_poses
from pipeline.model.turn import on_bearings
from pipeline.mounting import drive_of
from pipeline.sampling.errors import draw

STUDY = "rv_two_disks"
EDGES_PER_LOBE = 16
"""Edges of the mesh on the flank of a lobe."""
TWO_MESHES = 0.03
"""Compliances of one part on two crude meshes, over the largest: their holes lie otherwise between the elements."""
BACKLASH_UM = 30.0
"""Way of a planet from flank to flank, for the check of what the output has of it."""


def check_rv(specimen: Specimen) -> Iterator[Finding]:
    """RV reducer, two disks: ratio, crank bearings in closed form, first stage at the output; see ``STUDY``.

    An RV reducer under test stands in the place of that, without its two crude meshes.
    """
    is_own = isinstance(specimen.study.design.output, Carrier)
    study = specimen.study if is_own else crude_study(STUDY, EDGES_PER_LOBE)
    tight_study = _with_settings(study, {"bearing": {"clearance_um": 0.0}, "output.first_stage": {"backlash_um": 0.0}})
    yield _ratio(tight_study)
    if not is_own:
        blocks = blocks_of_one_part(tight_study)
        yield second_mesh(tight_study, blocks[1], TWO_MESHES)
        yield _shares(tight_study, blocks)
    yield from _bearings(tight_study)
    yield _backlash(tight_study)
    yield _compliance(tight_study)


def _with_settings(study: Study, changes: Mapping[str, Mapping[str, Any]]) -> Study:
    """The study with other settings of sections of its design."""
    design = study.design
    for path, values in changes.items():
        section, _, subsection = path.partition(".")
        update: Mapping[str, Any] = values
        if subsection:
            update = {subsection: getattr(getattr(design, section), subsection).model_copy(update=values)}
        design = design.model_copy(update={section: getattr(design, section).model_copy(update=update)})
    return study.model_copy(update={"design": design})


def _carrier(study: Study) -> Carrier:
    return cast(Carrier, study.design.output)


def _ratio(study: Study) -> Finding:
    """The sun turns by one: every contact stays closed, and the output turns by one over the ratio."""
    reducer, output = assembly.reducer(study.design, CRANK_DEG), _carrier(study)
    stage = output.first_stage
    sun_radius = output.crank_circle_radius_mm * stage.sun_teeth / (stage.sun_teeth + stage.planet_teeth)
    meshes = reducer.contacts.interface == 1
    rolled_length = np.where(meshes, sun_radius * (1 - 2 * reducer.contacts.face), 0.0)
    motion, *_ = np.linalg.lstsq(reducer.contact_jacobian, -rolled_length, rcond=None)
    left_open = np.max(np.abs(reducer.contact_jacobian @ motion + rolled_length)) / sun_radius
    ratio = 1 / motion[reducer.output_motion] if left_open < 1e-10 else np.nan
    teeth = stage.planet_teeth / stage.sun_teeth
    expected_ratio = 1 + teeth * study.design.cycloid.pins
    return relative("total ratio by the columns against 1 + z2 N/z1", expected_ratio, ratio, 1e-10)


def _drive(study: Study, compliance: Real | None) -> Drive:
    nominal = draw(study, 0, 1)
    errors = assembly.errors(nominal)
    errors = replace(errors, lobe=np.zeros_like(errors.lobe))  # the nominal unit has the grinding allowance
    clearance = assembly.bearing_clearance(study.design, nominal.bearing_clearance)
    return drive_of(study, CRANK_DEG, compliance, errors, clearance)


def _loaded_states(drive: Drive, torque: Real) -> Equilibria:
    play = general_play(drive.reducer, drive.gap, drive.bearing_clearance)
    pose = play.pose_plus if torque[0] > 0 else play.pose_minus
    return drive.equilibria(first_poses(drive, pose, torque[0]), torque)


def _of_pins(reducer: Reducer, disk: int) -> np.ndarray:
    return np.flatnonzero((reducer.disk_of_contact == disk) & (reducer.contacts.kind == PIN))


def _shares(study: Study, blocks: list[Real]) -> Finding:
    """Moment of the pins of either elastic disk, in both senses."""
    reducer = assembly.reducer(study.design, CRANK_DEG)
    drive, shares = _drive(study, assembly.joined_blocks(reducer, blocks)), []
    for sense in (1, -1):
        force = _loaded_states(drive, sense * drive.rated_torque * SHARES).force[0]
        moments = [force[:, rows] @ reducer.contacts.arm[rows] for rows in (_of_pins(reducer, 0), _of_pins(reducer, 1))]
        shares.append(moments[0] / np.sum(moments, axis=0))
    return largest_difference(
        "share of either perfect elastic disk in the moment of the pins", 0.5, np.array(shares), 1e-9
    )


def _bearings(study: Study) -> Iterator[Finding]:
    """Forces of the crank bearings on rigid perfect disks, and the balance of every motion."""
    drive, output = _drive(study, None), _carrier(study)
    teeth = output.first_stage
    reducer, pins = drive.reducer, study.design.cycloid.pins
    ratio_torque = teeth.planet_teeth * (pins - 1) / (teeth.sun_teeth + teeth.planet_teeth * pins)
    force_blocks: list[Complex] = []
    expected_forces: list[Complex] = []
    residual_forces = []
    for torque in np.concatenate([SHARES, -SHARES]) * drive.rated_torque:
        force = _loaded_states(drive, np.array([torque])).force[0, 0]
        load = np.where(np.arange(len(reducer.motions)) == reducer.output_motion, torque, 0.0)
        residual_forces.append(np.max(np.abs(force @ reducer.contact_jacobian - load)) / abs(torque))
        tangential = torque * ratio_torque / (reducer.n_disks * output.cranks * output.crank_circle_radius_mm)
        outwards = output.centres() / output.crank_circle_radius_mm * np.exp(1j * reducer.disks[0].rotation)
        force_blocks += list(-on_bearings(reducer, force[None, None])[0, 0] / torque)
        for disk in range(reducer.n_disks):
            of_pins = _of_pins(reducer, disk)
            resultant = np.sum(force[of_pins] * reducer.contacts.normal[of_pins])
            for crank in range(output.cranks):
                expected_forces.append((-resultant / output.cranks + 1j * outwards[crank] * tangential) / torque)
    scale = np.max(np.abs(expected_forces))
    reference, computed_forces = (
        np.array([values.real, values.imag]) for values in (np.array(expected_forces), np.array(force_blocks))
    )
    quantity = "force of each crank bearing over the torque, rigid perfect disks [1/mm]"
    yield largest_difference(quantity, reference, computed_forces, 1e-9, scale)
    yield largest_difference("balance of every motion over the torque", 0.0, np.array(residual_forces), 1e-9)


def _backlash(study: Study) -> Finding:
    """Play of rigid bodies without a gap but for that of the planets."""
    loose_study = _with_settings(study, {"output.first_stage": {"backlash_um": BACKLASH_UM}})
    reducer, output = assembly.reducer(loose_study.design, CRANK_DEG), _carrier(loose_study)
    stage = output.first_stage
    gap = np.where(reducer.contacts.kind == OUTPUT, reducer.contacts.gap, 0.0)[None]
    play = general_play(reducer, gap, np.full(1, loose_study.design.cycloid.eccentricity_mm)).backlash[0]
    angle = 1e-3 * BACKLASH_UM / output.planet_pitch_radius_mm
    closed_form = angle / (loose_study.design.cycloid.pins + stage.sun_teeth / stage.planet_teeth)
    return relative("backlash of the planets at the output: its angle over N + z1/z2 [rad]", closed_form, play, 1e-6)


def _compliance(study: Study) -> Finding:
    """What the output turns more by meshes half as stiff."""
    output, rotations = _carrier(study), []
    stiffness = output.first_stage.mesh_stiffness_N_per_mm
    for factor in (0.5, 1.0):
        soft = _with_settings(study, {"output.first_stage": {"mesh_stiffness_N_per_mm": factor * stiffness}})
        drive = _drive(soft, None)
        torque = drive.rated_torque * SHARES
        rotations.append(_loaded_states(drive, torque).motion[0, :, drive.reducer.output_motion])
    ratio = study.design.cycloid.pins + output.first_stage.sun_teeth / output.first_stage.planet_teeth
    meshes = torque / (output.cranks * stiffness * output.planet_pitch_radius_mm**2 * ratio**2)
    quantity = "rotation by meshes half as stiff: their compliance over (N + z1/z2)^2 [rad]"
    return largest_difference(quantity, meshes, rotations[0] - rotations[1], 1e-9, scale=rotations[1])
