"""Fit of the disk: clearance of its bearing, eccentricity, interference, wear of one flank, running in."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.model.effects.effect import CYCLES, LARGEST_INTERFERENCE, Conditions, Effect, Parameter
from pipeline.model.load_history.drive import Drive


def _apply_bearing_clearance(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    return replace(drive, bearing_clearance=drive.bearing_clearance + 1e-3 * values[0])


BEARING_CLEARANCE = Effect(
    name="bearing_clearance",
    title="clearance of the input bearing",
    physics="the disk's centre is free within a circle before its bearing carries",
    source="the paper, section 2.2, which calls it very small and leaves it out",
    parameters=(Parameter("clearance_um", "um", "radial clearance beyond the declared one"),),
    changes="radial clearance of the bearing",
    signature="play grows, and the same at every crank angle; little at high torque",
    confused_with=("pin_circle_error", "pin_radius_error", "eccentricity_error"),
    told_apart_by="the radial play of the input bearing with a dial gauge",
    bounds=lambda drive: ((0.0, 1e3 * drive.profile.eccentricity / 3),),
    apply=_apply_bearing_clearance,
)


def _eccentricity_error_symmetric(drive: Drive) -> tuple[float, float]:
    reach = 2e3 * LARGEST_INTERFERENCE * drive.profile.eccentricity
    return -reach, reach


ECCENTRICITY_ERROR = Effect(
    name="eccentricity_error",
    title="eccentricity of the crank larger or smaller",
    physics="the crank holds the disk further out than declared: gaps change by n . u de, to first order",
    source="exact gaps of a displaced disk",
    parameters=(Parameter("eccentricity_um", "um", "eccentricity larger by"),),
    changes="eccentricity",
    signature="other pins touch first; rigidity and play change together, alike at every crank angle",
    confused_with=("bearing_clearance", "pin_circle_error"),
    told_apart_by="the throw of the crank with a dial gauge",
    bounds=lambda drive: (_eccentricity_error_symmetric(drive),),
    apply=lambda drive, values, conditions: drive.with_added_errors(eccentricity=np.array(1e-3 * values[0])),
)


def _apply_preload(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    closing = np.zeros_like(drive.shift)
    closing[:, : drive.reducer.n_pins] = -1e-3 * values[0]
    return drive.with_added_gap(closing)


PRELOAD = Effect(
    name="preload",
    title="preload of the disk against its pins",
    physics="a disk pressed or grown into its pins closes every gap along the normal by the same amount",
    source="normal reading of a profile error (mechanics of gaps: g = -d on every flank)",
    parameters=(Parameter("interference_um", "um", "gap taken away at every pin"),),
    changes="gap of every pin",
    signature="no play, high rigidity near zero torque",
    confused_with=("pin_radius_error", "pin_circle_error"),
    told_apart_by="the running torque without load: interference raises it",
    bounds=lambda drive: ((0.0, 1e3 * LARGEST_INTERFERENCE * drive.profile.eccentricity),),
    apply=_apply_preload,
)


def _apply_flank_wear(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    opening, arm = np.zeros_like(drive.shift), drive.reducer.pins.arm
    worn = np.flatnonzero(arm < 0 if values[0] > 0 else arm > 0)
    opening[:, worn] = 1e-3 * abs(values[0])
    return drive.with_added_gap(opening)


FLANK_WEAR = Effect(
    name="flank_wear",
    title="wear of one flank",
    physics="the flanks that carry one sense of torque have lost material along their normal",
    source="uniform depth along the normal",
    parameters=(
        Parameter("depth_um", "um", "depth; positive: on the flanks that positive torque loads; negative: the others"),
    ),
    changes="gap of the pins that carry one sense of torque",
    signature="one end of the play moves, the other stays",
    confused_with=("pin_circle_error", "pin_radius_error"),
    told_apart_by="both flanks of a lobe on a form tester, or an absolute zero of the angle",
    bounds=lambda drive: ((-1e3 * drive.profile.eccentricity / 3, 1e3 * drive.profile.eccentricity / 3),),
    apply=_apply_flank_wear,
)


def _apply_run_in(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    worn = 1e-3 * values[0] * -np.expm1(-conditions.cycle / values[1])
    opening = np.zeros_like(drive.shift)
    opening[:, : drive.reducer.n_pins] = worn[:, None]
    return drive.with_added_gap(opening)


RUN_IN = Effect(
    name="run_in",
    title="running in over the load cycles",
    physics="the first cycles wear the flanks, ever more slowly, as asperities are worn off; a cycle is the usual way "
    "of the torque in one, counted from the start of a position, whose flanks are new to the load",
    source="Archard, J. Appl. Phys. 24 (1953) 981, with a pressure that falls as the surfaces conform",
    parameters=(
        Parameter("wear_um", "um", "depth of the wear at last"),
        Parameter("cycles", "1", "number of cycles in which 63 % of it is reached", record=CYCLES),
    ),
    changes="gap of every pin, with the cycle",
    signature="play grows from cycle to cycle and settles",
    confused_with=("thermal_growth", "angle_drift"),
    told_apart_by="ten further cycles, over which running in settles",
    bounds=lambda drive: ((0.0, 1e3 * drive.profile.eccentricity / 3), (0.3, 30.0)),
    apply=_apply_run_in,
    needs=frozenset({CYCLES}),
)

EFFECTS = (BEARING_CLEARANCE, ECCENTRICITY_ERROR, PRELOAD, FLANK_WEAR, RUN_IN)
