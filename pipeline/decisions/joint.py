"""A study's population as joints of simulators: backlash, stiffness and friction of its quantiles.

The reducer is two revolute joints in series: one turns freely within the backlash, the next is a
linear spring with Coulomb friction. Angles in rad, torques in N m. Each number is the quantile of its own quantity, not
of one unit.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pandas as pd

from pipeline.constant_kinds import Fineness
from pipeline.engine.table import Column, Table
from pipeline.errors import InputError
from pipeline.model.units import ARCMIN
from pipeline.statistics.intervals import quantile

LEVELS: Mapping[str, float] = {"p05": 0.05, "p50": 0.5, "p95": 0.95}
"""Quantiles that become joints."""
BACKLASH, RIGIDITY, LOSS = "clearance_backlash_arcmin", "torsional_rigidity_Nm_per_arcmin", "hysteresis_loss_arcmin"
ZERO_WIDTH, LOST_MOTION = "zero_torque_width_arcmin", "lost_motion_arcmin"
MASS_KG, INERTIA_KG_M2 = "0.1", "1e-4"
"""Of the links that a snippet needs to be a whole model; put in those of your own."""
STEP: Fineness = 5
"""Time steps of MuJoCo in a radian of the swing of one link on the spring; fewer than one are unstable."""
HARD_STOP = {"solreflimit": "1e-9 1", "solimplimit": "0.9999 0.9999 1e-9"}
"""The ends of the play as hard as MuJoCo has them, of any inertia: it lifts the time constant to two time steps. As
preset a torque of a few N m presses the joint far beyond them."""
EFFORT_NM, VELOCITY_RAD_PER_S = "1e6", "1e3"
"""Limits that URDF asks of a revolute joint, beyond any reducer."""

JOINTS = Table(
    "joints",
    "quantile",
    (
        Column("quantile", "label", "", "of each quantity by itself, over the samples; the mean over the turn"),
        Column("backlash_rad", "float64", "rad", "clearance backlash"),
        Column("stiffness_Nm_per_rad", "float64", "N m/rad", "torsional rigidity"),
        Column("friction_Nm", "float64", "N m", "half of the hysteresis loss times the stiffness about zero torque"),
    ),
)


@dataclass(frozen=True)
class Joint:
    """Backlash [rad], stiffness [N m/rad] and Coulomb friction [N m] of one quantile of a population."""

    quantile: str
    backlash_rad: float
    stiffness_Nm_per_rad: float
    friction_Nm: float


def joints(units: pd.DataFrame, torque_Nm: float) -> list[Joint]:
    """Joints of the quantiles of `LEVELS`.

    Parameters
    ----------
    units : ``<metric>_mean`` of each sample over the turn.
    torque_Nm : at which the lost motion is read.

    Raises
    ------
    InputError
        If no unit has all metrics.

    Notes
    -----
    Coulomb friction T_f beside a spring K leaves it wound by T_f/K at no load, from either side, so that the loop is
    2 T_f/K wider than the play at zero torque: T_f = K loss/2. Contacts are softer there than under load, so K is the
    secant of the centre lines from the ends of the play to the lost motion, at the same angles as the loss.
    """
    columns = [f"{name}_mean" for name in (BACKLASH, RIGIDITY, LOSS, ZERO_WIDTH, LOST_MOTION)]
    values = units[columns].dropna().to_numpy(float)
    if not len(values):
        raise InputError("no unit has backlash, rigidity and hysteresis loss; a joint needs all of them")
    backlash, rigidity, loss, zero_width, lost_motion = values.T
    winding = lost_motion - (zero_width - loss)
    friction = np.divide(torque_Nm * loss, winding, out=np.zeros_like(loss), where=(loss > 0) & (winding > 0))
    rows = np.stack([backlash / ARCMIN, ARCMIN * rigidity, friction])
    return [Joint(name, *(quantile(row, level) for row in rows)) for name, level in LEVELS.items()]


def mujoco(joint: Joint) -> str:
    """The joint as a model of MuJoCo (MJCF)."""
    model = Element("mujoco", model=f"reducer_{joint.quantile}")
    SubElement(model, "compiler", angle="radian")
    step = np.sqrt(float(INERTIA_KG_M2) / joint.stiffness_Nm_per_rad) / STEP
    SubElement(model, "option", timestep=f"{step:.3g}")
    body = SubElement(SubElement(model, "worldbody"), "body", name="input_side")
    half = 0.5 * joint.backlash_rad
    play = {"name": "backlash", "type": "hinge", "axis": "0 0 1", "limited": "true"}
    SubElement(body, "joint", play, range=f"{-half:.9g} {half:.9g}", **HARD_STOP)
    _inertia(body)
    output = SubElement(body, "body", name="output")
    stiffness, friction = f"{joint.stiffness_Nm_per_rad:.9g}", f"{joint.friction_Nm:.9g}"
    spring = {"name": "spring", "type": "hinge", "axis": "0 0 1", "stiffness": stiffness, "frictionloss": friction}
    SubElement(output, "joint", spring)
    _inertia(output)
    return _text(model)


def _inertia(body: Element) -> None:
    inertia = " ".join([INERTIA_KG_M2] * 3)
    SubElement(body, "inertial", pos="0 0 0", mass=MASS_KG, diaginertia=inertia)


def urdf(joint: Joint) -> str:
    """The joint as a robot of URDF, which knows no spring: its stiffness stands in Gazebo's extension."""
    robot = Element("robot", name=f"reducer_{joint.quantile}")
    for name in ("housing", "input_side", "output"):
        inertial = SubElement(SubElement(robot, "link", name=name), "inertial")
        SubElement(inertial, "mass", value=MASS_KG)
        moments = dict.fromkeys(("ixx", "iyy", "izz"), INERTIA_KG_M2) | dict.fromkeys(("ixy", "ixz", "iyz"), "0")
        SubElement(inertial, "inertia", moments)
    half, friction = 0.5 * joint.backlash_rad, joint.friction_Nm
    _urdf_joint(robot, "backlash", ("housing", "input_side"), (f"{-half:.9g}", f"{half:.9g}"), "0")
    _urdf_joint(robot, "spring", ("input_side", "output"), ("-3.14159", "3.14159"), f"{friction:.9g}")
    extension = SubElement(robot, "gazebo", reference="spring")
    SubElement(extension, "springStiffness").text = f"{joint.stiffness_Nm_per_rad:.9g}"
    SubElement(extension, "springReference").text = "0"
    return _text(robot)


def _urdf_joint(robot: Element, name: str, links: tuple[str, str], ends: tuple[str, str], friction: str) -> None:
    joint = SubElement(robot, "joint", name=name, type="revolute")
    SubElement(joint, "parent", link=links[0])
    SubElement(joint, "child", link=links[1])
    SubElement(joint, "axis", xyz="0 0 1")
    SubElement(joint, "limit", lower=ends[0], upper=ends[1], effort=EFFORT_NM, velocity=VELOCITY_RAD_PER_S)
    SubElement(joint, "dynamics", damping="0", friction=friction)


def sdf(joint: Joint) -> str:
    """The joint as a model of SDFormat 1.7."""
    root = Element("sdf", version="1.7")
    model = SubElement(root, "model", name=f"reducer_{joint.quantile}")
    for name in ("housing", "input_side", "output"):
        SubElement(model, "link", name=name)
    half = 0.5 * joint.backlash_rad
    play = _sdf_joint(model, "backlash", "housing", "input_side")
    limit = SubElement(play, "limit")
    SubElement(limit, "lower").text, SubElement(limit, "upper").text = f"{-half:.9g}", f"{half:.9g}"
    dynamics = SubElement(_sdf_joint(model, "spring", "input_side", "output"), "dynamics")
    SubElement(dynamics, "friction").text = f"{joint.friction_Nm:.9g}"
    SubElement(dynamics, "spring_reference").text = "0"
    SubElement(dynamics, "spring_stiffness").text = f"{joint.stiffness_Nm_per_rad:.9g}"
    return _text(root)


def _sdf_joint(model: Element, name: str, parent: str, child_link: str) -> Element:
    joint = SubElement(model, "joint", name=name, type="revolute")
    SubElement(joint, "parent").text, SubElement(joint, "child").text = parent, child_link
    axis = SubElement(joint, "axis")
    SubElement(axis, "xyz").text = "0 0 1"
    return axis


FORMATS = {"mjcf.xml": mujoco, "urdf": urdf, "sdf": sdf}
"""Endings of the files and what writes them."""


def _text(root: Element) -> str:
    ElementTree.indent(root)
    note = "<!-- Angles in rad, torques in N m; masses, inertias and the time step for them are placeholders. -->\n"
    return note + ElementTree.tostring(root, encoding="unicode") + "\n"
