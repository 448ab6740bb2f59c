"""Where the metrics of a response mean what they say: small rotations, small clearances, friction below the load.

How a stage calls it: after ``response = respond(drive, cycle)`` of one chunk at one crank angle,

    invalid = invalid_metrics(drive, response, definitions)

gives for every metric the reason of each state, ``""`` where the number stands. The stage writes the reason into the
status of that metric and leaves the number out of every statistic (or says that it is in). Rows that did not converge
have a status of their own; their reasons here mean nothing.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from pipeline.arrays import Real
from pipeline.model.equilibrium.solve import Equilibria
from pipeline.model.geometry.clearance import Errors
from pipeline.model.geometry.contacts import PIN
from pipeline.model.geometry.cycloid_profile import NOMINAL, CycloidProfile
from pipeline.model.geometry.rigid_play.rigid_backlash import rigid_play
from pipeline.model.load_history.drive import NO_TORQUE, Drive
from pipeline.model.load_history.load_cycle import BRANCHES
from pipeline.model.load_history.response import CycleResponse
from pipeline.model.metrics import Definitions, Metric, library
from pipeline.model.units import NMM_PER_NM

LARGEST_ROTATION = 0.1
"""Rotation of a body, over a lobe's pitch, beyond which arms and normals of the nominal pose are not its contacts' any
more: where play alone turns the paper's disk so far, small angles give 15 % too little."""
LARGEST_CLEARANCE = 0.1
"""Gap that a carrying pin or hole closes, and clearance of the bearing, over the eccentricity or, if that is less, the
height of the lobes. Up to it small angles err by 0.3 % of the rigid play with 80 pins and by 2 % with 12 (the error is
of the second order: 1.6 % at 100 um and 16 % at 350 um with the paper's 350 um of eccentricity)."""
LARGEST_PLAY_CHANGE = 0.05
"""What finite motions add to the rigid play of a modified flank without errors, over that play: beyond it pins near the
roots touch elsewhere than their nominal normals say, and forces and play at small loads do not hold. It is below 0.001
of equidistant and moved flanks with room for them, and 0.3 and more of one that is turned by 1 arcmin."""
MODIFICATION = "the modified flank touches elsewhere than at its nominal contacts"
ROTATION = "rotation beyond a tenth of a lobe pitch"
CLEARANCE = "clearance or interference beyond a tenth of the eccentricity"
STUCK = "friction holds the output at the torque of its definition"
SHORT_OF_PLAY = "friction holds the output within its play at no torque"


def _steps_of(response: CycleResponse, branch: str, torque: float) -> int:
    on_branch = np.flatnonzero(response.branch == BRANCHES.index(branch))
    return int(on_branch[np.argmin(np.abs(response.torque[on_branch] - torque))])


def _rotation(drive: Drive, response: CycleResponse, largest_torque: float) -> Real:
    """Largest rotation (n,) of any body at torques up to the largest [rad]."""
    turning = [i for i, motion in enumerate(drive.reducer.motions) if motion.endswith("_phi")]
    states_within = response.state[np.abs(response.torque) <= largest_torque * (1 + 1e-9)]
    rotation: Real = np.max(np.abs(response.equilibria.motion[:, states_within][:, :, turning]), axis=(1, 2))
    return rotation


def _clearance(drive: Drive, response: CycleResponse, torque: float) -> Real:
    """Largest gap (n,) that a loaded pin or hole closes at +-``torque``, or clearance of a bearing if larger [mm]."""
    contacts = drive.reducer.contacts
    is_round = (contacts.kind == PIN) | (contacts.hole >= 0)  # the normal of a flat does not turn with its gap
    steps = [_steps_of(response, "loading+", torque), _steps_of(response, "loading-", -torque)]
    carries = np.any(response.equilibria.force[:, response.state[steps]][:, :, is_round] > 0, axis=1)
    largest_closing: Real = np.max(np.abs(drive.gap[:, is_round]), axis=1, where=carries, initial=0.0)
    if not drive.reducer.is_centred:
        return largest_closing
    larger: Real = np.maximum(largest_closing, np.max(drive.clearance_of_disks, axis=1))
    return larger


def _moves_contacts(drive: Drive) -> bool:
    """Whether finite motions change the rigid play that the flank's modification alone leaves by too much."""
    if drive.profile.modification == NOMINAL:
        return False
    no_errors = Errors(**{name: np.zeros_like(values[:1]) for name, values in vars(drive.errors).items()})
    nominal = replace(
        drive.without_elements,
        errors=no_errors,
        shift=np.zeros_like(drive.shift[:1]),
        bearing_clearance=np.zeros_like(drive.bearing_clearance[:1]),
        known_gap=None,
    )
    play = rigid_play(nominal.reducer, nominal.gap, nominal.bearing_clearance).backlash[0]
    return not abs(nominal.backlash_change[0]) <= LARGEST_PLAY_CHANGE * play


def _stuck(drive: Drive, response: CycleResponse, torque: float) -> np.ndarray:
    """Whether (n,) the reducer carries nothing of ``torque`` on a loading branch in its sense: friction takes it."""
    angle = response.equilibria.motion[:, :, drive.reducer.output_motion]
    rising: Real = angle[:, response.state[_steps_of(response, "reloading+", torque)]]
    falling = angle[:, response.state[_steps_of(response, "loading-", -torque)]]
    end_minus, end_plus = (response.play - drive.twist(NO_TORQUE)).T
    stuck: np.ndarray = (rising <= end_plus) | (falling >= end_minus)
    return stuck


def _reason(
    drive: Drive, response: CycleResponse, metric: Metric, definitions: Definitions, rotation: Real
) -> Iterator[tuple[np.ndarray, str]]:
    """States (n,) in which the metric does not hold, and why, the first reason first."""
    yield rotation > LARGEST_ROTATION * drive.profile.lobe_pitch, ROTATION
    if len(drive.sliders.acting) and metric.moves_at is not None:
        yield _stuck(drive, response, NMM_PER_NM * metric.moves_at(definitions)), STUCK
    if len(drive.sliders.acting) and metric.not_negative:
        yield response.hysteresis_loss < 0, SHORT_OF_PLAY


def invalid_metrics(drive: Drive, response: CycleResponse, definitions: Definitions) -> Mapping[str, np.ndarray]:
    """Reason (n,) why a metric does not hold in a state, ``""`` where it does, by the metric's name.

    Parameters
    ----------
    response : of the drive to a cycle that has the torques of the metrics.
    definitions : torques at which the metrics are read.

    Notes
    -----
    A body's rotation counts up to the torque that a metric asks for. Friction: constant, growing with the load or at
    the pins, it is judged by what it does: on the loading branch, at the torque of the definition, nothing has passed
    through the play to the other side. With a constant friction torque M that is M >= the torque. A loss below zero is
    friction, too: it keeps the output from the end of its play (presliding longer than the play; rubbing pins in a disk
    that its bearing lets go).
    """
    largest_clearance = LARGEST_CLEARANCE * min(drive.profile.eccentricity, _height(drive.profile))
    moves_contacts = _moves_contacts(drive)
    is_displaced = _clearance(drive, response, NMM_PER_NM * definitions.lost_motion) > largest_clearance
    torques = {name: NMM_PER_NM * metric.largest_torque(definitions) for name, metric in library().items()}
    rotations = {torque: _rotation(drive, response, torque) for torque in set(torques.values())}
    reasons = {}
    for name, metric in library().items():
        reason = np.empty(len(is_displaced), object)
        reason[:] = MODIFICATION if moves_contacts else ""
        reason[is_displaced] = CLEARANCE
        for states, text in _reason(drive, response, metric, definitions, rotations[torques[name]]):
            if np.any(states):
                reason[states & (reason == "")] = text
        reasons[name] = reason
    return reasons


@lru_cache
def _height(profile: CycloidProfile) -> float:
    """Height of the lobes [mm]."""
    return float(np.ptp(np.abs(profile.flank(np.linspace(0, profile.lobe_pitch, 201)))))


def beyond_limit_share(drive: Drive, states: Equilibria) -> np.ndarray:
    """Share of the pins' moment on contacts beyond their law's range (n, n_states)."""
    contacts = drive.reducer.contacts
    of_pins = contacts.kind == PIN
    force = states.force[..., of_pins]
    moment = np.abs(contacts.arm[of_pins]) * force
    beyond_law = np.sum(moment, axis=2, where=force > drive.laws_of_states.force_limit[..., of_pins])
    total: Real = np.sum(moment, axis=2)
    share: np.ndarray = np.divide(beyond_law, total, out=np.zeros_like(total), where=total > 0)
    return share
