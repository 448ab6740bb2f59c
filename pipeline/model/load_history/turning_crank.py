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

A drive that is preloaded stores an energy V0 without torque. W begins with -V0, so that the motor feels V0 fall and
rise over the crank angle: at no torque of the output its own is -dV0/dphi.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline, PPoly

from pipeline.arrays import Real
from pipeline.model.load_history.backbone import Backbone
from pipeline.model.load_history.drive import Drive

STEPS, CLOSE = 50, 1e-13
"""Newton steps to a root at most, and change of the angle [rad] that ends them."""
KEPT_SPLINES = 64
"""Sets of crank angles for which unit splines are kept."""
FEWEST_CRANKS = 5
"""Crank angles below which every second one does not tell the error of interpolation: a parabola takes three."""


@dataclass(frozen=True)
class CurvesOverCrank:
    """Frictionless curves of one state of a drive at several crank angles, with the crank held.

    Attributes
    ----------
    crank : (n_cranks,) ascending [rad].
    torque : (n_nodes,) ascending [N mm], none of them 0, as many of either sense.
    angle : (n_cranks, n_nodes) of the output [rad].
    elastic_energy : (n_cranks, 2) energy without torque, at its limits from below and above [N mm]; 0 without preload.
    period : after which the curves repeat [rad]: a turn of the crank where no error belongs to a single pin, lobe or
        hole, else a turn of the output; 0 where they are known between the first and the last crank angle alone.
    extended : whether the curves are extended by straight lines beyond the first and the last crank angle; otherwise
        an angle beyond is refused. A fit may pass through sizes that turn the crank further than it was measured.
    """

    crank: Real
    torque: Real
    angle: Real
    elastic_energy: Real | float = 0.0
    period: float = 0.0
    extended: bool = False

    @classmethod
    def from_drives(
        cls, drives: Sequence[Drive], backbones: Sequence[Backbone], crank: Real, state: int = 0, extended: bool = False
    ) -> "CurvesOverCrank":
        """The curves of drives in one of their states, known between crank angles (n_cranks,) [rad]."""
        pairs = list(zip(drives, backbones, strict=True))
        torque = drives[0].stiffening(state) * backbones[0].torque
        angles = np.array([curve.angle[state] + drive.twist(torque) for drive, curve in pairs])
        elastic_energy = np.array([stored_energy(drive, curve, state) for drive, curve in pairs])
        return cls(np.asarray(crank, float), torque, angles, elastic_energy, extended=extended)

    @cached_property
    def spline(self) -> PPoly:
        """Angles (n_nodes,) over the crank angle."""
        return self._spline(slice(None))

    @property
    def error(self) -> float:
        """Largest error of the angle [rad] at left-out crank angles, where every second one is interpolated over.

        Raises
        ------
        ValueError : fewer than ``FEWEST_CRANKS`` crank angles.
        """
        if len(self.crank) < FEWEST_CRANKS:
            raise ValueError(f"{len(self.crank)} crank angles; the error of interpolation takes {FEWEST_CRANKS}")
        coarse = self._spline(slice(None, None, 2))
        inside = slice(1, None, 2) if self.period else slice(1, len(self.crank) - 1, 2)
        return float(np.max(np.abs(coarse(self.crank[inside]) - self.angle[inside])))

    def locked_curve(self, start: float, ratio: float) -> "LockedCurve":
        """The curve with the output locked where the crank stands at ``start`` [rad].

        Parameters
        ----------
        ratio : i, with its sign.

        Raises
        ------
        ValueError : the crank leaves the angles known, or so much varies over it that the motor's torque does not rise
            with the angle: the drive jumps.
        """
        delta = self.spline(self.crank_in_range(np.array([start])))[0]
        for _ in range(STEPS):
            angle, slope = self._at_nodes(start - ratio * delta)
            step = (angle - delta) / (1 + ratio * slope)
            delta = delta + step
            if np.max(np.abs(step)) < CLOSE:
                break
        crank = start - ratio * delta
        _, energy_slope = self._energies._at_nodes(crank)
        motor = self.torque + ratio * energy_slope
        if np.any(np.diff(motor) <= 0) or np.any(1 + ratio * slope <= 0):
            raise ValueError("the drive varies so much over the crank angle that it jumps; smaller torques do not")
        # close to the play two nodes differ by less than what cubics between the stations are off by
        return LockedCurve(motor, np.maximum.accumulate(delta), self.torque, crank)

    def _at_nodes(self, crank: Real) -> tuple[Real, Real]:
        """Angle and its derivative (n_nodes,) of the curve of each node at a crank angle of its own (n_nodes,)."""
        placed_crank, breaks = self.crank_in_range(crank), self.spline.x
        interval = np.clip(np.searchsorted(breaks, placed_crank, "right") - 1, 0, len(breaks) - 2)
        x = placed_crank - breaks[interval]
        cubic, square, line, constant = self.spline.c[:, interval, np.arange(len(crank))]
        slope = line + x * (2 * square + 3 * x * cubic)
        straight = 0.0 if self.period else slope * (crank - placed_crank)
        return constant + x * (line + x * (square + x * cubic)) + straight, slope

    @cached_property
    def _energies(self) -> "CurvesOverCrank":
        """The curves with the complementary energy (n_cranks, n_nodes) in place of the angle.

        A spline is linear in its values: its integral over the torque is the spline of the integrals.
        """
        middle, energy = len(self.torque) // 2, np.empty_like(self.angle)
        stored = np.broadcast_to(self.elastic_energy, (len(self.crank), 2)).T[:, :, None]
        for number, outwards in enumerate((slice(middle - 1, None, -1), slice(middle, None))):
            torque, angle = self.torque[outwards], self.angle[:, outwards]
            to_first_node = angle[:, :1] * torque[0]
            energy[:, outwards] = cumulative_trapezoid(angle, torque, initial=0.0) + to_first_node - stored[number]
        return replace(self, angle=energy)

    def _spline(self, nodes: slice) -> PPoly:
        crank, angle = self.crank[nodes], self.angle[nodes]
        if not self.period:
            basis = _spline_basis(crank.tobytes())
            return PPoly.construct_fast(np.tensordot(basis.c, angle, axes=1), basis.x)
        return CubicSpline(np.append(crank, crank[0] + self.period), np.vstack([angle, angle[:1]]), bc_type="periodic")

    def crank_in_range(self, crank: Real) -> Real:
        """Crank angles (n,) within those known [rad].

        Raises
        ------
        ValueError : they are not.
        """
        if self.period:
            placed: Real = self.crank[0] + np.mod(crank - self.crank[0], self.period)
            return placed
        if self.extended:
            return np.clip(crank, self.crank[0], self.crank[-1])
        if np.min(crank) < self.crank[0] or np.max(crank) > self.crank[-1]:
            range_deg = np.degrees([np.min(crank), np.max(crank), self.crank[0], self.crank[-1]])
            raise ValueError("the crank turns from {:.1f} to {:.1f} deg; known is {:.1f} to {:.1f}".format(*range_deg))
        return crank


@lru_cache(maxsize=KEPT_SPLINES)
def _spline_basis(crank: bytes) -> CubicSpline:
    """Cubic splines over crank angles (n,) of unit values at one of them each: others are their linear combination."""
    angles = np.frombuffer(crank)
    return CubicSpline(angles, np.eye(len(angles)))


def stored_energy(drive: Drive, curve: Backbone, state: int) -> Real:
    """Elastic energy (2,) [N mm] of a drive in one of its states at the limits of no torque from below and from above.

    Of each contact F d(F) less the integral of d over F, of the bodies f C f / 2, of a bearing F d / (n + 1).
    """
    force = curve.limits.force[state][::-1]
    if not np.any(force):
        return np.zeros(2)
    law = drive.laws
    contacts = np.sum(force * law.deflection(force) - law.energy(force), axis=-1)
    bodies = 0.5 * np.sum((force @ drive.compliance) * force, axis=-1)
    thrust = drive.reducer.thrust(force[None])[0]
    bearings = np.sum(thrust * drive.bearing.depth(thrust), axis=-1) / (1 + drive.bearing.exponent)
    return np.asarray(drive.stiffening(state) * (contacts + bodies + bearings))


@dataclass(frozen=True)
class LockedCurve:
    """Frictionless curve of a drive with its output locked; nodes and angles of ``output_path``.

    Attributes
    ----------
    torque : (n_nodes,) of the motor times i [N mm], ascending.
    angle : (n_nodes,) twist of the output against the motor's angle over i [rad].
    carried_torque : (n_nodes,) torque at the output [N mm].
    crank : (n_nodes,) crank angle reached [rad].
    """

    torque: Real
    angle: Real
    carried_torque: Real
    crank: Real
