"""Effects of the library, put into the rigid drive from their descriptions alone: none of their code is used."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.arrays import Real
from tests.validation.blind.rigid_drive.drive import RigidDrive

Changed = Callable[[RigidDrive, float, float], RigidDrive]
"""A drive, load cycles before, and temperature over that of the drawing [K], to the drive with an effect."""

MM_PER_UM = 1e-3
"""Millimetres of a micrometre."""
RAD_PER_ARCMIN = np.pi / 180 / 60
"""Radians of an arc minute."""
NMM_PER_NM = 1e3
"""N mm of a N m."""


@dataclass(frozen=True)
class Sensors:
    """What the bench reads wrongly: torque zero [N m] and gain [1], drift [arcmin/h], the encoder's wave [arcmin]."""

    torque_zero: float = 0.0
    torque_gain: float = 0.0
    drift: float = 0.0
    encoder_cosine: float = 0.0
    encoder_sine: float = 0.0


@dataclass(frozen=True)
class Effect:
    """What one effect changes, by its values.

    Attributes
    ----------
    drive : of the drive, or None.
    train, sensors : numbers by their names.
    changes_with : "cycle" or "temperature" where the drive changes with it, else "".
    """

    drive: Callable[[Sequence[float]], Changed] | None = None
    train: Callable[[Sequence[float]], Mapping[str, float]] = field(default=lambda values: {})
    sensors: Callable[[Sequence[float]], Mapping[str, float]] = field(default=lambda values: {})
    changes_with: str = ""


def _pins_moved(drive: RigidDrive, outwards: Real | float) -> RigidDrive:
    """Pins moved away from the axis [mm]."""
    centres = drive.pin_centres
    return replace(drive, pin_centres=centres + outwards * centres / np.abs(centres))


def _oval(order: int) -> Callable[[Sequence[float]], Changed]:
    def effect(values: Sequence[float]) -> Changed:
        def changed(drive: RigidDrive, cycle: float, warmer: float) -> RigidDrive:
            pin_angle = np.angle(drive.pin_centres)
            cosine, sine = values[0] * np.cos(order * pin_angle), values[1] * np.sin(order * pin_angle)
            return _pins_moved(drive, MM_PER_UM * (cosine + sine))

        return changed

    return effect


def _pins_off_axis(values: Sequence[float]) -> Changed:
    centre = MM_PER_UM * complex(*values)
    return lambda drive, cycle, warmer: replace(drive, pin_centres=drive.pin_centres + centre)


def _flank_off_bore(values: Sequence[float]) -> Changed:
    centre = MM_PER_UM * complex(*values)
    return lambda drive, cycle, warmer: replace(drive, flank=replace(drive.flank, centre=drive.flank.centre + centre))


def _worn(values: Sequence[float]) -> Changed:
    """Of the two flanks of every lobe, those that a rotation of the depth's sign presses."""

    def changed(drive: RigidDrive, cycle: float, warmer: float) -> RigidDrive:
        parameter = drive.flank.nominal_parameters(drive.rotation)
        pressed = np.sin(drive.flank.lobes * parameter) * values[0] < 0
        return replace(drive, pin_growth=drive.pin_growth - MM_PER_UM * abs(values[0]) * pressed)

    return changed


def _everywhere(depth_um: Callable[[Sequence[float], float], float]) -> Callable[[Sequence[float]], Changed]:
    """Gaps of all pins closed along their normals, by a depth of values and cycle."""
    return lambda values: (
        lambda drive, cycle, warmer: replace(drive, pin_growth=drive.pin_growth + MM_PER_UM * depth_um(values, cycle))
    )


def _warm(values: Sequence[float]) -> Changed:
    per_kelvin = 1e-6 * values[0]
    return lambda drive, cycle, warmer: _pins_moved(drive, per_kelvin * warmer * drive.flank.circle_radius)


def _eccentric(values: Sequence[float]) -> Changed:
    return lambda drive, cycle, warmer: replace(
        drive, eccentric=drive.eccentric * (1 + MM_PER_UM * values[0] / abs(drive.eccentric))
    )


def _loose(values: Sequence[float]) -> Changed:
    return lambda drive, cycle, warmer: replace(
        drive, bearing=replace(drive.bearing, clearance=drive.bearing.clearance + MM_PER_UM * values[0])
    )


def _soft_seats(values: Sequence[float]) -> Changed:
    return lambda drive, cycle, warmer: replace(
        drive, pin_contact=replace(drive.pin_contact, compliance=drive.pin_contact.compliance + MM_PER_UM * values[0])
    )


EFFECTS: Mapping[str, Effect] = {
    "bearing_clearance": Effect(_loose),
    "coulomb": Effect(train=lambda values: {"friction": NMM_PER_NM * values[0]}),
    "creep": Effect(train=lambda values: {"creep": RAD_PER_ARCMIN / NMM_PER_NM * values[0], "creep_time": values[1]}),
    "directional_load_friction": Effect(
        train=lambda values: {"drive_friction": values[0], "backdrive_friction": values[1]}
    ),
    "eccentricity_error": Effect(_eccentric),
    "flank_runout": Effect(_flank_off_bore),
    "flank_wear": Effect(_worn),
    "load_friction": Effect(train=lambda values: {"load_friction": values[0]}),
    "output_torsion": Effect(train=lambda values: {"twist": RAD_PER_ARCMIN / NMM_PER_NM * values[0]}),
    "ovality_2": Effect(_oval(2)),
    "ovality_3": Effect(_oval(3)),
    "pin_circle_error": Effect(lambda values: lambda drive, cycle, warmer: _pins_moved(drive, MM_PER_UM * values[0])),
    "pin_circle_runout": Effect(_pins_off_axis),
    "pin_radius_error": Effect(_everywhere(lambda values, cycle: values[0])),
    "preload": Effect(_everywhere(lambda values, cycle: values[0])),
    "presliding": Effect(
        train=lambda values: {"bristles": NMM_PER_NM * values[0], "reach": RAD_PER_ARCMIN * values[1]}
    ),
    "run_in": Effect(
        _everywhere(lambda values, cycle: -values[0] * (1 - float(np.exp(-cycle / values[1])))), changes_with="cycle"
    ),
    "seat_compliance": Effect(_soft_seats),
    "softening_compliance": Effect(
        train=lambda values: {"soft_twist": RAD_PER_ARCMIN / NMM_PER_NM * values[0], "knee": NMM_PER_NM * values[1]}
    ),
    "thermal_growth": Effect(_warm, changes_with="temperature"),
    "torque_zero": Effect(sensors=lambda values: {"torque_zero": values[0]}),
    "torque_gain": Effect(sensors=lambda values: {"torque_gain": values[0]}),
    "angle_drift": Effect(sensors=lambda values: {"drift": values[0]}),
    "encoder_eccentricity": Effect(sensors=lambda values: {"encoder_cosine": values[0], "encoder_sine": values[1]}),
}
"""By name in the library. Friction at the pins and cogging are missing: the disk's history is not followed here."""
