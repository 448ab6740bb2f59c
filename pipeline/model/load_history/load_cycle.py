"""The load cycle 0 -> +T -> -T -> +T on the output, the states it visits and the numbers read off its curve.

Without friction a state depends on the torque alone: each torque is solved once, from the free play outwards, and
the branches of the cycle visit the states. T = 0 stands as two states, the ends 0+ and 0- of the free play.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.model.equilibrium.solve import Equilibria
from pipeline.model.geometry.cycloid_profile import Real
from pipeline.model.geometry.rigid_play.rigid_backlash import rigid_play
from pipeline.model.load_history.backbone import first_poses
from pipeline.model.load_history.drive import Drive
from pipeline.model.units import ARCMIN as ARCMIN

BRANCHES = ("loading+", "unloading+", "loading-", "unloading-", "reloading+")
LIMIT_TORQUE = 1e-8
"""Share of the rated torque that stands for the limit T -> 0 where preload leaves no rigid play: its twist is below
1e-7 arcmin; smaller shares drown in the rounding of the preload."""


@dataclass(frozen=True)
class LoadCycle:
    """Torques of a cycle.

    Attributes
    ----------
    rated_torque : [N mm]
    fractions : (n_levels,) ascending shares of the rated torque, the last one the cycle's top.
    """

    rated_torque: float
    fractions: Real

    @classmethod
    def evenly(cls, rated_torque: float, levels: int, top: float, marks: tuple[float, ...]) -> "LoadCycle":
        """``levels`` equal steps up to the share ``top`` of the rated torque, and exactly the shares ``marks``.

        Raises
        ------
        ValueError
            If a mark lies above the top.
        """
        if max(marks) > top * (1 + 1e-12):
            raise ValueError(f"a metric asks for {max(marks):g} of the rated torque, the cycle ends at {top:g}")
        steps = top * np.arange(1, levels + 1) / max(levels, 1)
        even_steps = steps[
            np.min(np.abs(steps[:, None] - np.asarray(marks)), axis=1) > 1e-9 * top
        ]  # none if levels is 0
        return cls(rated_torque, np.unique(np.concatenate([even_steps, marks])))

    @property
    def state_torque(self) -> Real:
        """Torque of every state (n_states,) [N mm]: 0+, the positive levels, 0-, the negative levels."""
        levels = np.concatenate([[0.0], self.rated_torque * self.fractions])
        return np.concatenate([levels, -levels])

    @property
    def steps(self) -> tuple[np.ndarray, np.ndarray]:
        """Branch number and state of every step of the cycle, (n_steps,) each."""
        upward = np.arange(len(self.fractions) + 1)
        downward = upward[-2::-1]
        negative = len(upward)
        visits = [upward, downward, upward + negative, downward + negative, upward]
        branch = np.repeat(np.arange(len(visits)), [len(v) for v in visits])
        return branch, np.concatenate(visits)


def solve_cycle(drive: Drive, cycle: LoadCycle) -> Equilibria:
    """The frictionless states of the cycle; arrays (n, n_states, ...) in the order of ``cycle.state_torque``.

    Notes
    -----
    The states at zero torque are the ends of the rigid play, free of force. In a preloaded sample forces act at zero
    torque too; its two ends are the equilibria at +-``LIMIT_TORQUE`` of the rated torque. Where that is not found from
    the end of the rigid play, it is come down to from the first level: forces that close an interface which has play
    are 1e-8 of those of the preload, and a start that opens it loses them in the rounding of the preload.
    """
    play = rigid_play(drive.reducer, drive.gap, drive.bearing_clearance)
    senses = []
    for sense, pose in ((1.0, play.pose_plus), (-1.0, play.pose_minus)):
        levels = sense * cycle.rated_torque * cycle.fractions
        start = first_poses(drive, pose, levels[0])
        senses.append(_with_end(_loaded(drive, start, pose, levels), pose))
        if np.any(play.preloaded):
            preloaded = play.preloaded
            limit = sense * LIMIT_TORQUE * cycle.rated_torque
            end = drive.some(preloaded).softened_equilibria(start[preloaded], np.array([limit]))
            senses[-1][preloaded, 0] = end[:, -1]
            lost = preloaded & ~senses[-1].converged[:, 0]
            if np.any(lost):
                end = drive.some(lost).softened_equilibria(start[lost], np.array([levels[0], limit]))
                senses[-1][lost, 0] = end[:, -1]
    return Equilibria.joined(senses, axis=1)


def _loaded(drive: Drive, start: Real, pose: Real, levels: Real) -> Equilibria:
    """Equilibria at torques (n_levels,) [N mm] of one sense from the least up; where one fails, from the largest down.

    Under load disks lean on their loose bearings, so that few torques there lack a start.
    """
    states = drive.softened_equilibria(start, levels)
    failed = np.flatnonzero(~np.all(states.converged, axis=1))
    if len(failed):
        remaining = drive.some(failed)
        leaning = first_poses(remaining, pose[failed], levels[-1])
        downward = remaining.softened_equilibria(leaning, levels[::-1])
        solved = np.all(downward.converged, axis=1)
        states[failed[solved]] = downward[solved, ::-1]
    return states


def _with_end(loaded_states: Equilibria, pose: Real) -> Equilibria:
    """The loaded states of one sense behind the force-free end of play."""
    n = len(pose)
    end = Equilibria(
        motion=pose[:, None],
        force=np.zeros((n, 1, loaded_states.force.shape[2])),
        iterations=np.zeros((n, 1), np.int64),
        residual=np.zeros((n, 1)),
        converged=np.ones((n, 1), bool),
    )
    return Equilibria.joined((end, loaded_states), axis=1)
