"""The load cycle of a drive: its curve with friction, and the ends of its free play without.

One definition of the three numbers at zero torque, with or without effects:

* clearance backlash: angle between the limits T -> 0- and T -> 0+ of the *frictionless elastic* drive. Where the gaps
  leave room the forces vanish with the torque, so the limits are the ends of the rigid play (the program of
  ``rigid_backlash``); where contacts interfere the elastic equilibria take their place, which deform the bodies under
  the preload and may leave some play, or none;
* zero-torque width: width of the loop at zero torque, friction included;
* hysteresis loss: the width less the backlash.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Real
from pipeline.model.elements import Path
from pipeline.model.equilibrium.solve import Equilibria
from pipeline.model.load_history.drive import NO_TORQUE, Drive
from pipeline.model.load_history.friction.frictional_cycle import refined_cycle, solve_frictional_cycle
from pipeline.model.load_history.load_cycle import BRANCHES, LoadCycle, solve_cycle


@dataclass(frozen=True)
class CycleResponse:
    """A drive's ``n`` states (samples) through a load cycle.

    Attributes
    ----------
    branch : (n_steps,) branch of every step, its index in ``BRANCHES``.
    torque : (n_steps,) on the output [N mm]; 0 stands for the limit from the branch's side.
    carried_torque : (n_steps,), or (n, n_steps) with friction on the output: torque in the reducer and the elements in
        series.
    angle : (n, n_steps) of the turning end [rad], the elements in series with the output included.
    state : (n_steps,) equilibrium that a step visits: its second index in ``equilibria``.
    equilibria : (n, n_equilibria, ...); without friction a torque has one, with friction every step has its own.
    play : (n, 2) angle [rad] at the frictionless limits T -> 0- and T -> 0+.
    converged : (n,) whether every step and both limits were solved.
    """

    branch: np.ndarray
    torque: Real
    carried_torque: Real
    angle: Real
    state: np.ndarray
    equilibria: Equilibria
    play: Real
    converged: np.ndarray

    @property
    def clearance_backlash(self) -> Real:
        """(n,) [rad]"""
        return self.play[:, 1] - self.play[:, 0]

    @property
    def zero_torque_width(self) -> Real:
        """(n,) [rad] angle on the way down from +T less that on the way up from -T, both at zero torque."""
        downward, upward = (self._zero_of(name) for name in ("unloading+", "unloading-"))
        return self.angle[:, downward] - self.angle[:, upward]

    @property
    def hysteresis_loss(self) -> Real:
        """(n,) [rad] exactly zero without friction."""
        return self.zero_torque_width - self.clearance_backlash

    def _zero_of(self, branch: str) -> int:
        return int(np.flatnonzero((self.branch == BRANCHES.index(branch)) & (self.torque == 0))[0])


def respond(drive: Drive, cycle: LoadCycle) -> CycleResponse:
    """The drive through the load cycle 0 -> +T -> -T -> +T, with friction if it has any.

    Parameters
    ----------
    cycle : its levels; those of the metrics alone (``LoadCycle.evenly`` with no levels but the marks) are enough, with
        friction too: the history between them is followed in smaller steps all the same.

    Raises
    ------
    ValueError
        If the drive creeps: a load cycle has no time; if it has friction, and its modulus differs from state to state.
    """
    if any(element.needs_time for element in drive.hystereses):
        raise ValueError("a load cycle has no time, so a drive that creeps has no response to it")
    frictional = len(drive.sliders.acting) > 0
    if frictional and drive.modulus is not None:
        raise ValueError("friction does not change with the modulus, so states of several have no response with it")
    levels = refined_cycle(cycle) if frictional else cycle
    frictionless = solve_cycle(drive, levels)
    branch, state = cycle.steps
    torque = cycle.state_torque[state]
    limits = [len(levels.fractions) + 1, 0]  # 0-, 0+
    motion = drive.reducer.output_motion
    equilibria, is_converged = frictionless, np.all(frictionless.converged[:, limits], axis=1)
    carried_torque = torque
    if frictional:
        path = solve_frictional_cycle(drive, cycle, frictionless)
        equilibria, carried_torque, state = path.equilibria, path.carried_torque, np.arange(len(state))
    along = Path(torque, None)
    twist = drive.twist(torque) + sum(element.twist(along) for element in drive.hystereses)
    angle = equilibria.motion[:, state, motion] + twist
    return CycleResponse(
        branch=branch,
        torque=torque,
        carried_torque=carried_torque,
        angle=angle,
        state=state,
        equilibria=equilibria,
        play=frictionless.motion[:, limits, motion] + drive.twist(NO_TORQUE),
        converged=is_converged & np.all(equilibria.converged, axis=1),
    )
