"""Where the metrics of a response mean what they say: small rotations, small clearances, friction below the load.

How a stage calls it: after ``response = respond(drive, cycle)`` of one chunk at one crank angle,

    invalid = invalid_metrics(drive, response, lost_motion, rigidity)

gives for every metric the reason of each state, ``""`` where the number stands. The stage writes the reason into the
status of that metric and leaves the number out of every statistic (or says that it is in). Rows that did not converge
have a status of their own; their reasons here mean nothing.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from pipeline.model.geometry.cycloid_profile import Real
from pipeline.model.geometry.reducer import PIN
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.load_cycle import BRANCHES
from pipeline.model.load_history.response import CycleResponse

LARGEST_ROTATION = 0.1
"""Rotation of a body, over a lobe's pitch, beyond which arms and normals of the nominal pose are not its contacts' any
more: where play alone turns the paper's disk so far, small angles give 15 % too little."""
LARGEST_CLEARANCE = 0.1
"""Gap that a carrying pin closes, and clearance of the bearing, over the eccentricity or, if that is less, the height
of the lobes. Up to it small angles err by 0.3 % of the rigid play with 80 pins and by 2 % with 12 (the error is of the
second order: 1.6 % at 100 um and 16 % at 350 um with the paper's 350 um of eccentricity)."""
METRICS = (
    "clearance_backlash",
    "zero_torque_width",
    "lost_motion",
    "torsional_rigidity",
    "hysteresis_loss",
    "peak_pressure",
)
ROTATION = "rotation beyond a tenth of a lobe pitch"
CLEARANCE = "clearance beyond a tenth of the eccentricity"
STUCK_AT_LOST_MOTION = "friction holds the output at the torque of the lost motion"
STUCK_AT_RIGIDITY = "friction holds the output at the torque of the rigidity"
SHORT_OF_PLAY = "friction holds the output within its play at no torque"


@dataclass(frozen=True)
class _Guard:
    """``states`` (n,) in which the ``metrics`` do not hold, and why."""

    metrics: tuple[str, ...]
    states: np.ndarray
    reason: str


def _steps_of(response: CycleResponse, branch: str, torque: float) -> int:
    on_branch = np.flatnonzero(response.branch == BRANCHES.index(branch))
    return int(on_branch[np.argmin(np.abs(response.torque[on_branch] - torque))])


def _rotation(drive: Drive, response: CycleResponse, largest_torque: float) -> Real:
    """Largest rotation (n,) of any body at torques up to the largest [rad]."""
    turning = [i for i, motion in enumerate(drive.reducer.motions) if motion.endswith("_phi")]
    within = response.state[np.abs(response.torque) <= largest_torque * (1 + 1e-9)]
    return np.max(np.abs(response.equilibria.motion[:, within][:, :, turning]), axis=(1, 2))


def _clearance(drive: Drive, response: CycleResponse, torque: float) -> Real:
    """Largest gap (n,) that a pin closes which carries at +-``torque``, and the bearing's clearance [mm]."""
    of_pins = drive.reducer.contacts.kind == PIN
    steps = [_steps_of(response, "loading+", torque), _steps_of(response, "loading-", -torque)]
    carries = np.any(response.equilibria.force[:, response.state[steps]][:, :, of_pins] > 0, axis=1)
    closed = np.max(np.abs(drive.gap[:, of_pins]), axis=1, where=carries, initial=0.0)
    return np.maximum(closed, drive.bearing_clearance)


def _stuck(drive: Drive, response: CycleResponse, torque: float) -> np.ndarray:
    """Whether (n,) the reducer carries nothing of ``torque`` on a loading branch in its sense: friction takes it."""
    twist = drive.torsion * torque
    rising = response.angle[:, _steps_of(response, "reloading+", torque)] - twist
    falling = response.angle[:, _steps_of(response, "loading-", -torque)] + twist
    return (rising <= response.play[:, 1]) | (falling >= response.play[:, 0])


def _guards(
    drive: Drive, response: CycleResponse, lost_motion: float, rigidity: tuple[float, float]
) -> Iterator[_Guard]:
    height = float(np.ptp(np.abs(drive.profile.flank(np.linspace(0, drive.profile.lobe_pitch, 201)))))
    limit = LARGEST_CLEARANCE * min(drive.profile.eccentricity, height)
    low, high = (share * drive.rated_torque for share in rigidity)
    yield _Guard(METRICS, _clearance(drive, response, lost_motion * drive.rated_torque) > limit, CLEARANCE)
    for metrics, torque in (
        (("clearance_backlash", "zero_torque_width", "hysteresis_loss"), 0.0),
        (("lost_motion",), lost_motion * drive.rated_torque),
        (("torsional_rigidity",), high),
        (("peak_pressure",), np.inf),
    ):
        rotation = _rotation(drive, response, torque)
        yield _Guard(metrics, rotation > LARGEST_ROTATION * drive.profile.lobe_pitch, ROTATION)
    if len(drive.sliders.acting):
        yield _Guard(("lost_motion",), _stuck(drive, response, lost_motion * drive.rated_torque), STUCK_AT_LOST_MOTION)
        yield _Guard(("torsional_rigidity",), _stuck(drive, response, low), STUCK_AT_RIGIDITY)
        yield _Guard(("hysteresis_loss",), response.hysteresis_loss < 0, SHORT_OF_PLAY)


def invalid_metrics(
    drive: Drive, response: CycleResponse, lost_motion: float, rigidity: tuple[float, float]
) -> Mapping[str, np.ndarray]:
    """Reason (n,) why a metric does not hold in a state, ``""`` where it does, by the names of ``METRICS``.

    Parameters
    ----------
    response : of the drive to a cycle that has the torques of the metrics.
    lost_motion, rigidity : shares of the rated torque that define the metrics, as for ``load_cycle.curve_metrics``.

    Notes
    -----
    A body's rotation counts up to the torque that a metric asks for. Friction: constant, growing with the load or at
    the pins, it is judged by what it does: on the loading branch, at the torque of the definition, nothing has passed
    through the play to the other side. With a constant friction torque M that is M >= the torque. A loss below zero is
    friction, too: it keeps the output from the end of its play (presliding longer than the play; rubbing pins in a disk
    that its bearing lets go).
    """
    reasons = {metric: np.full(len(response.play), "", object) for metric in METRICS}
    for guard in _guards(drive, response, lost_motion, rigidity):
        for metric in guard.metrics:
            reasons[metric][guard.states & (reasons[metric] == "")] = guard.reason
    return reasons
