"""The frictionless curve of a drive whose output is locked while its crank turns.

At each crank angle phi the output turns by a(T, phi) under a torque T while the crank is held. With the output locked
it is the crank that turns, to phi = phi_0 - i a, where i is its turns per turn of the output: -Z with the housing held,
N with the flange held. A state of the locked drive is therefore the root of delta = a(T, phi_0 - i delta), and gaps,
transmission error and stiffness are those of the crank angle reached.

Virtual work. With the complementary energy W(T, phi), the integral of a over the torque, and V = T a - W, the torque of
the motor times i, which does the work dV along phi, is

    i tau = T + i dW/dphi at constant T,

for a pure angle error T (1 + i dte/dphi). Friction on the output acts beside it: the curve takes the place of a
``Backbone`` in ``output_path``, with all memory kept along the path.

A drive that is preloaded stores energy without torque, which varies over the crank angle and is not in W: it is
refused.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from pipeline.model.geometry.cycloid_profile import Real
from pipeline.model.load_history.backbone import Backbone

STEPS, CLOSE = 50, 1e-13
"""Newton steps to a root at most, and change of the angle [rad] that ends them."""
FEWEST_CRANKS = 6
"""Crank angles below which every second one does not tell the error of interpolation."""


@dataclass(frozen=True)
class CurvesOverCrank:
    """Frictionless curves of one state of a drive at several crank angles, with the crank held.

    Attributes
    ----------
    crank : (n_cranks,) ascending [rad].
    torque : (n_nodes,) ascending [N mm], none of them 0, as many of either sense.
    angle : (n_cranks, n_nodes) of the output [rad].
    period : after which the curves repeat [rad]: a turn of the crank where no error belongs to a single pin, lobe or
        hole, else a turn of the output; 0 where they are known between the first and the last crank angle alone.
    """

    crank: Real
    torque: Real
    angle: Real
    period: float = 0.0

    @classmethod
    def of(cls, backbones: list[Backbone], crank: Real, period: float = 0.0, state: int = 0) -> "CurvesOverCrank":
        """Of the curves of drives at crank angles (n_cranks,) [rad].

        Raises
        ------
        ValueError : one of them is preloaded.
        """
        if any(np.all(np.any(curve.limits.force[state] > 0, axis=-1)) for curve in backbones):
            raise ValueError("a preloaded drive stores energy without torque, whose work on the crank is not known")
        angles = np.array([curve.angle[state] for curve in backbones])
        return cls(np.asarray(crank, float), backbones[0].torque, angles, period)

    @cached_property
    def spline(self) -> CubicSpline:
        """Angles (n_nodes,) over the crank angle."""
        return self._spline(slice(None))

    @property
    def error(self) -> float:
        """Largest error of the angle [rad] at left-out crank angles, where every second one is interpolated over.

        It bounds the error of all of them: a cubic's falls sixteenfold with twice as many angles.

        Raises
        ------
        ValueError : fewer than ``FEWEST_CRANKS`` crank angles.
        """
        if len(self.crank) < FEWEST_CRANKS:
            raise ValueError(f"{len(self.crank)} crank angles; the error of interpolation takes {FEWEST_CRANKS}")
        coarse = self._spline(slice(None, None, 2))
        inside = slice(1, None, 2) if self.period else slice(1, len(self.crank) - 1, 2)
        return float(np.max(np.abs(coarse(self.crank[inside]) - self.angle[inside])))

    def locked(self, start: float, ratio: float) -> "LockedCurve":
        """The curve with the output locked where the crank stands at ``start`` [rad].

        Parameters
        ----------
        ratio : i, with its sign.

        Raises
        ------
        ValueError : the crank leaves the angles known, or so much varies over it that the motor's torque does not rise
            with the angle: the drive jumps.
        """
        delta, nodes = self.spline(self._placed(np.array([start])))[0], np.arange(len(self.torque))
        for _ in range(STEPS):
            crank = self._placed(start - ratio * delta)
            excess = self.spline(crank)[nodes, nodes] - delta
            step = excess / (1 + ratio * self.spline(crank, 1)[nodes, nodes])
            delta = delta + step
            if np.max(np.abs(step)) < CLOSE:
                break
        crank = start - ratio * delta
        slopes = self.spline(self._placed(crank), 1)
        work = np.array([self._integral(slopes[k], int(k)) for k in nodes])
        motor = self.torque + ratio * work
        if np.any(np.diff(motor) <= 0) or np.any(np.diff(delta) < 0):
            raise ValueError("the drive varies so much over the crank angle that it jumps; smaller torques do not")
        return LockedCurve(motor, delta, self.torque, crank)

    def _integral(self, values: Real, node: int) -> float:
        """Integral of values (n_nodes,) over the torque from none to a node, cubic on its side of the play."""
        middle = len(self.torque) // 2
        side = slice(middle, None) if node >= middle else slice(None, middle)
        torque, inner = self.torque[side], self.torque[middle if node >= middle else middle - 1]
        first = values[middle if node >= middle else middle - 1] * inner  # from none to the first node
        return float(PchipInterpolator(torque, values[side]).integrate(inner, self.torque[node]) + first)

    def _spline(self, chosen: slice) -> CubicSpline:
        crank, angle = self.crank[chosen], self.angle[chosen]
        if not self.period:
            return CubicSpline(crank, angle)
        return CubicSpline(np.append(crank, crank[0] + self.period), np.vstack([angle, angle[:1]]), bc_type="periodic")

    def _placed(self, crank: Real) -> Real:
        """Crank angles within those known.

        Raises
        ------
        ValueError : they are not.
        """
        if self.period:
            return self.crank[0] + np.mod(crank - self.crank[0], self.period)
        if np.min(crank) < self.crank[0] or np.max(crank) > self.crank[-1]:
            known = np.degrees([np.min(crank), np.max(crank), self.crank[0], self.crank[-1]])
            raise ValueError("the crank turns from {:.1f} to {:.1f} deg; known is {:.1f} to {:.1f}".format(*known))
        return crank


@dataclass(frozen=True)
class LockedCurve:
    """Frictionless curve of a drive with its output locked; nodes and angles of ``output_path``.

    Attributes
    ----------
    torque : (n_nodes,) of the motor times i [N mm], ascending.
    angle : (n_nodes,) twist of the output against the motor's angle over i [rad].
    carried : (n_nodes,) torque at the output [N mm].
    crank : (n_nodes,) crank angle reached [rad].
    """

    torque: Real
    angle: Real
    carried: Real
    crank: Real
