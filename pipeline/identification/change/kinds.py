"""Kinds of change of a drive that are looked for between two measurements."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from pipeline.identification.generic.play_and_friction import PlayAndFriction


@dataclass(frozen=True)
class Kind:
    """One number by which the second state differs from the first.

    Attributes
    ----------
    name, title : of the number.
    unit : of the number.
    grows, falls : what is said of a change of either sign.
    put : drive and change to the changed drive.
    told_apart_by : the measurement that tells it from the others.
    """

    name: str
    title: str
    unit: str
    grows: str
    falls: str
    put: Callable[[PlayAndFriction, float], PlayAndFriction]
    told_apart_by: str


KINDS = (
    Kind(
        "play",
        "play",
        "arcmin",
        "play opens",
        "play closes",
        lambda drive, amount: replace(drive, play_arcmin=drive.play_arcmin + amount),
        "a small torque by hand in both senses: play is crossed at next to no torque",
    ),
    Kind(
        "friction",
        "friction",
        "N m",
        "friction grows",
        "friction falls",
        lambda drive, amount: replace(drive, friction_Nm=drive.friction_Nm + amount),
        "the torque that turns the drive slowly without load",
    ),
    Kind(
        "compliance",
        "compliance, as a share",
        "1",
        "stiffness falls",
        "stiffness grows",
        lambda drive, amount: replace(
            drive,
            compliance_arcmin_per_Nm=(1 + amount) * drive.compliance_arcmin_per_Nm,
            softening_arcmin_per_Nm2=(1 + amount) * drive.softening_arcmin_per_Nm2,
        ),
        "the slope of the same branch between half and all of the load",
    ),
    Kind(
        "torque_zero",
        "zero of the torque, or preload of one sense",
        "N m",
        "zero of the torque rises, or a preload",
        "zero of the torque falls, or a preload",
        lambda drive, amount: replace(drive, torque_zero_Nm=drive.torque_zero_Nm + amount),
        "the reading of the torque with the drive taken off",
    ),
)
