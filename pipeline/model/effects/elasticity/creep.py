"""Delayed elasticity in series with the output."""

from collections.abc import Sequence
from dataclasses import replace

from pipeline.model.effects.effect import LOOPS, RATE, TIME, Conditions, Effect, Parameter, largest_twist
from pipeline.model.load_history.drive import Creep, Drive
from pipeline.model.load_history.load_cycle import ARCMIN


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    return replace(drive, creep=Creep(1e-3 * values[0] / ARCMIN, values[1]))


EFFECT = Effect(
    name="creep",
    title="delayed elasticity of soft parts",
    physics="a part of the twist follows the torque with a delay: spring and damper in parallel, behind the output",
    source="Kelvin-Voigt; Findley, Lai, Onaran, Creep and Relaxation of Nonlinear Viscoelastic Materials (1976)",
    parameters=(
        Parameter("compliance_arcmin_per_Nm", "arcmin/(N m)", "delayed twist per torque at last"),
        Parameter("time_s", "s", "time in which 63 % of it is reached", record=TIME),
    ),
    changes="adds a delayed rotation to that of the output",
    signature="angle runs on at constant torque; loops open with slow loading",
    confused_with=("presliding", "rayleigh"),
    told_apart_by="the angle over an hour at constant load",
    bounds=lambda drive: ((0.0, largest_twist(drive)), (0.05, 1e4)),
    apply=_apply,
    needs=frozenset({TIME, RATE, LOOPS}),
)
