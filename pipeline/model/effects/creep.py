"""Delayed elasticity in series with the output."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pipeline.arrays import Real
from pipeline.model.compiled import entry, part
from pipeline.model.effects.effect import LOOPS, RATE, TIME, Effect, Parameter, largest_twist
from pipeline.model.elements import Hysteresis, Path
from pipeline.model.units import ARCMIN

State = tuple[float, float, float]
"""Delayed rotation [rad], torque [N mm] and time [s]; the time of a state at rest is NaN: it starts with the path."""


@part
def _on(
    twist: float, interval: float, torque_before: float, torque_after: float, constant: float, compliance: float
) -> float:
    """Delayed rotation after a time in which the torque went linearly from ``torque_before`` to ``torque_after``."""
    share = max(interval, 0.0) / constant
    remaining: float = np.exp(-share)
    mean: float = -np.expm1(-share) / share if share > 0.0 else 1.0
    return twist * remaining + compliance * (torque_after * (1.0 - mean) + torque_before * (mean - remaining))


@entry
def _crept(torque: Real, time: Real, state: State, constant: float, compliance: float, crept: Real) -> float:
    """Delayed rotation at the points of a path, from a state; the last one is returned."""
    twist, torque_before, time_before = state
    for k in range(torque.shape[0]):
        twist = _on(twist, time[k] - time_before, torque_before, torque[k], constant, compliance)
        torque_before, time_before = torque[k], time[k]
        crept[k] = twist
    return twist


@dataclass(frozen=True)
class KelvinVoigt(Hysteresis):
    """Delayed compliance [rad/(N mm)] in series with the output, and its time constant [s].

    Exact for a torque that is linear in time between the points of a path.

    Source
    ------
    Kelvin-Voigt element under piecewise linear load; Findley, Lai, Onaran, Creep and Relaxation of Nonlinear
    Viscoelastic Materials (1976), ch. 5.
    """

    compliance: float
    time_constant: float
    needs_time: ClassVar[bool] = True

    def start(self) -> State:
        """At rest."""
        return 0.0, 0.0, np.nan

    def advance(self, state: State, path: Path) -> tuple[Real, State]:
        """Delayed rotation [rad] (n,); raises ValueError for a path without time."""
        if path.time is None:
            raise ValueError("a path without time has no delayed rotation")
        twist, torque_before, time_before = state
        crept = np.empty(len(path.torque))
        begin = float(path.time[0]) if np.isnan(time_before) else time_before
        state = twist, torque_before, begin
        last = _crept(path.torque, path.time, state, self.time_constant, self.compliance, crept)
        return crept, (last, float(path.torque[-1]), float(path.time[-1]))


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
    apply=lambda drive, values, conditions: drive.with_elements(KelvinVoigt(1e-3 * values[0] / ARCMIN, values[1])),
    needs=frozenset({TIME, RATE, LOOPS}),
)
