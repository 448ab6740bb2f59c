"""A loop without the coupling of its contacts: every body rigid, every contact on a spring of its own.

From the ends of the rigid play each part of the chain turns on its own springs under the same torque, its centre held;
their rotations add up. Where cranks carry the disks, the pins alone are such a part, and the rest stays rigid. One sort
of the contacts per part takes the place of an equilibrium of all bodies.

Source
------
Winkler, Die Lehre von der Elasticitaet und Festigkeit (1867), ch. 18: a foundation of independent springs; of the pins
of a cycloid disk: Blanche, Yang, Cycloid drives with machining tolerances, J. Mech. Trans. Autom. Des. 111 (1989).
"""

import numpy as np

from pipeline.arrays import Real
from pipeline.model.compiled import entry
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.geometry.rigid_play.rigid_backlash import ARM_FLOOR, rigid_play
from pipeline.model.load_history.drive import NO_TORQUE, Drive
from pipeline.model.metrics import Definitions, LoopReadings
from pipeline.model.units import ARCMIN, NMM_PER_NM


def secant_compliance(drive: Drive, force: Real) -> Real:
    """Compliance (n_contacts,) [mm/N] of independent springs, alike within a part of the chain.

    Parameters
    ----------
    force : (..., n_contacts) [N] of equilibria of the drive.

    Notes
    -----
    Under the forces the springs of a part take the work, sum F d, that its contacts do by their laws and the bodies'
    compliance. The bearing gives way to the centre alone, which is held here.
    """
    interface = drive.reducer.contacts.interface
    work = force * (drive.laws_of_states.deflection(force) + drive.elastic_deflection(force))
    compliance = np.empty(len(interface))
    for part in np.unique(interface):
        rows = interface == part
        compliance[rows] = np.sum(work[..., rows]) / np.sum(force[..., rows] ** 2)
    return compliance


@entry
def _turn(gap: Real, arm: Real, compliance: Real, pressure: Real, torques: Real, angle: Real, peak: Real) -> None:
    """Add the rotation to ``angle`` (n, n_torques), raise ``peak`` (n,); torques ascend.

    The moment of the springs grows with the rotation, linearly between the rotations at which a contact closes (arm
    above 0) or opens (below 0): they are passed in their order.
    """
    for s in range(gap.shape[0]):
        ends = gap[s] / arm
        order = np.argsort(ends)
        slope, offset, n_passed = 0.0, 0.0, 0
        for k in range(arm.shape[0]):
            if arm[k] < 0.0:
                slope += arm[k] * arm[k] / compliance[k]
                offset += arm[k] * gap[s, k] / compliance[k]
        for t in range(torques.shape[0]):
            while n_passed < arm.shape[0] and slope * ends[order[n_passed]] - offset < torques[t]:
                k = order[n_passed]
                sense = 1.0 if arm[k] > 0.0 else -1.0
                slope += sense * arm[k] * arm[k] / compliance[k]
                offset += sense * arm[k] * gap[s, k] / compliance[k]
                n_passed += 1
            phi = (torques[t] + offset) / slope
            angle[s, t] += phi
            for k in range(arm.shape[0]):
                force = (arm[k] * phi - gap[s, k]) / compliance[k]
                if force > 0.0:
                    peak[s] = max(peak[s], pressure[k] * np.sqrt(force))


def _one_sense(drive: Drive, compliance: Real, pose: Real, torques: Real, peak: Real) -> Real:
    """Angle of the output (n, n_torques) [rad] at ascending torques of one sense, from poses at its end of play."""
    contacts, reducer = drive.reducer.contacts, drive.reducer
    room = drive.gap - pose @ reducer.contact_jacobian.T
    angle = pose[:, [reducer.output_motion]] + drive.twist(torques)
    closing = _closing(reducer)
    for part in np.unique(contacts.interface) if reducer.is_centred else [contacts.interface[0]]:
        rows = contacts.interface == part
        rows = np.flatnonzero(rows & (np.abs(closing) > ARM_FLOOR * np.max(np.abs(closing[rows]))))
        room_there, pressure = np.ascontiguousarray(room[:, rows]), drive.laws.pressure[rows]
        _turn(room_there, closing[rows], compliance[rows], pressure, torques, angle, peak)
    return np.asarray(angle)


def _closing(reducer: Reducer) -> Real:
    """Penetration of each contact (n_contacts,) [mm/rad] by the rotation of the output, all other parts rigid.

    Where cranks carry the disks the motions follow from the closed contacts of the output, and pins alone have one.
    """
    if reducer.is_centred:
        return -reducer.flange_ratio * reducer.contacts.arm
    jacobian, output = reducer.contact_jacobian[reducer.n_pins :], reducer.output_motion
    other_motions = np.delete(np.arange(len(reducer.motions)), output)
    motion = np.eye(len(reducer.motions))[output]
    motion[other_motions] = np.linalg.lstsq(jacobian[:, other_motions], -jacobian[:, output], rcond=None)[0]
    return np.asarray(reducer.contact_jacobian @ motion)


def winkler_readings(drive: Drive, compliance: Real, definitions: Definitions) -> LoopReadings:
    """Readings of the frictionless loops of ``n`` states up to the torques of the definitions.

    Parameters
    ----------
    compliance : of the springs (n_contacts,) [mm/N], as ``secant_compliance`` finds them; the drive's own is not used.
    definitions : torques at which the metrics are read.
    """
    play = rigid_play(drive.reducer, drive.gap, drive.bearing_clearance)
    levels = NMM_PER_NM * np.array([definitions.lost_motion, definitions.rigidity_low, definitions.rigidity_high])
    order, peak = np.argsort(levels), np.zeros(len(drive.gap))
    plus, minus = np.empty((2, len(peak), len(levels)))
    plus[:, order] = ARCMIN * _one_sense(drive, compliance, play.pose_plus, levels[order], peak)
    minus[:, order[::-1]] = ARCMIN * _one_sense(drive, compliance, play.pose_minus, -levels[order[::-1]], peak)
    twist_minus, twist_plus = drive.twist(NO_TORQUE)
    output = drive.reducer.output_motion
    limits = [ARCMIN * (play.pose_minus[:, output] + twist_minus), ARCMIN * (play.pose_plus[:, output] + twist_plus)]
    return LoopReadings(
        limit_minus=limits[0],
        limit_plus=limits[1],
        zero_falling=limits[1],
        zero_rising=limits[0],
        lost_motion_minus=minus[:, 0],
        lost_motion_plus=plus[:, 0],
        low_minus=minus[:, 1],
        high_minus=minus[:, 2],
        low_plus=plus[:, 1],
        high_plus=plus[:, 2],
        peak_pressure=peak,
        load_share=np.ones(len(peak)),
    )
