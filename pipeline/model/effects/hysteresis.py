"""Friction with a memory of the path: presliding, and rate-independent hysteresis of soft parts."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Real
from pipeline.model.compiled import entry
from pipeline.model.contact.friction_elements import output_sliders
from pipeline.model.effects.effect import LOOPS, Conditions, Effect, Parameter, largest_twist
from pipeline.model.elements import Friction, Hysteresis, Path
from pipeline.model.load_history.drive import Drive
from pipeline.model.units import ARCMIN, NMM_PER_NM

SHARES = np.array([0.25, 0.5, 0.75, 1.0])
"""Distances of the four equal elements, as shares of the last one's."""


def _apply_presliding(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    torque, distance = 1e3 * values[0], values[1] / ARCMIN
    limit = np.full(len(SHARES), torque / len(SHARES))
    return drive.with_elements(Friction(output_sliders(drive.reducer, limit, distance * SHARES)))


PRESLIDING = Effect(
    name="presliding",
    title="friction that yields before it slides",
    physics="bristles of different reach bend before they slip: four equal elastic-slip elements in parallel, which "
    "slip after 1/4, 1/2, 3/4 and all of the distance",
    source="Iwan, J. Appl. Mech. 33 (1966) 893; Al-Bender et al., IEEE Trans. Autom. Control 50 (2005) 1883",
    parameters=(
        Parameter("torque_Nm", "N m", "friction torque once all slide, referred to the output"),
        Parameter("distance_arcmin", "arcmin", "rotation that raises it fully from zero; twice that after a reversal"),
    ),
    changes="four sliders on the rotation of the output",
    signature="branches part smoothly after a reversal; minor loops are lenses",
    confused_with=("coulomb", "contact_friction"),
    told_apart_by="minor loops about a constant load: presliding friction makes lenses of them",
    limit_case="coulomb",
    bounds=lambda drive: ((0.0, 0.5e-3 * drive.rated_torque), (0.1, 10.0)),
    apply=_apply_presliding,
    needs=frozenset({LOOPS}),
)


@entry
def _followed(
    torque: Real, turns: tuple[Real, Real], count: int, state: tuple[float, float, float], twist: Real
) -> tuple[int, float, float, float]:
    """Twist over the coefficient along torques, from a state with ``count`` turning points, which are continued.

    Returns the number of turning points, torque, twist and sense at the end.
    """
    (turn_torque, turn_twist), (torque_now, twist_now, sense) = turns, state
    for k in range(torque.shape[0]):
        goal = torque[k]
        onward = 1.0 if goal >= torque_now else -1.0
        if goal != torque_now:
            if sense != 0.0 and onward != sense:
                turn_torque[count], turn_twist[count] = torque_now, twist_now
                count += 1
            sense = onward
        # a loop closes where the torque passes the turn before the last: both are forgotten
        while count > 2 and onward * (goal - turn_torque[count - 2]) >= 0.0:
            count -= 2
        if count == 2 and onward * goal >= abs(turn_torque[1]):
            count = 1
        if count == 1:
            twist_now = goal * abs(goal)
        else:
            distance = goal - turn_torque[count - 1]
            twist_now = turn_twist[count - 1] + 0.5 * distance * abs(distance)
        torque_now = goal
        twist[k] = twist_now
    return count, torque_now, twist_now, sense


State = tuple[Real, Real, float, float, float]
"""Torques [N mm] and twists over the coefficient of the turning points, then torque, twist and sense at the last."""


@dataclass(frozen=True)
class Rayleigh(Hysteresis):
    """Twist with a loop of any size between any two torques, which has a memory of its turning points.

    The first loading goes along eta T |T|, every later stretch along eta/2 (T - Tr) |T - Tr| from its turn Tr. A loop
    that closes is forgotten, and beyond the largest torque the first curve continues.

    Attributes
    ----------
    coefficient : eta [rad/(N mm)^2]; a loop between +-T has the area 4/3 eta T^3.

    Source
    ------
    Lord Rayleigh, Phil. Mag. 23 (1887) 225; with the memory of turns as Preisach's model of constant density:
    Review of Play and Preisach Models for Hysteresis in Magnetic Materials, Materials 16 (2023) 2422.
    """

    coefficient: float

    def start(self) -> State:
        """At rest without torque."""
        return np.zeros(1), np.zeros(1), 0.0, 0.0, 0.0

    def advance(self, state: State, path: Path) -> tuple[Real, State]:
        """Rotation [rad] (n,)."""
        n, known = len(path.torque), len(state[0])
        turns, twist = (np.empty(known + n + 1), np.empty(known + n + 1)), np.empty(n)
        turns[0][:known], turns[1][:known] = state[:2]
        count, torque, last_twist, sense = _followed(path.torque, turns, known, state[2:], twist)
        return self.coefficient * twist, (turns[0][:count].copy(), turns[1][:count].copy(), torque, last_twist, sense)


RAYLEIGH = Effect(
    name="rayleigh",
    title="rate-independent hysteresis of soft parts",
    physics="joints, seats and polymers lose energy by slip within them: the twist goes with the square of the "
    "torque's change since it last turned, at any speed, and a loop between +-T has the area 4/3 eta T^3",
    source="Lord Rayleigh, Phil. Mag. 23 (1887) 225; as the simplest case of Preisach's model: Review of Play and "
    "Preisach Models for Hysteresis in Magnetic Materials, Materials 16 (2023) 2422",
    parameters=(
        Parameter("coefficient_arcmin_per_Nm2", "arcmin/(N m)2", "twist of the first loading per torque squared"),
    ),
    changes="a twist with memory between the output and the torque",
    signature="loops open with the square of the torque and are lenses; the angle moves at once where the torque turns",
    confused_with=("creep", "presliding", "load_friction"),
    told_apart_by="the same loop at a tenth of the speed, or a hold under load: creep goes on, this stands still",
    bounds=lambda drive: ((0.0, 1e3 * largest_twist(drive) / drive.rated_torque),),
    apply=lambda drive, values, conditions: drive.with_elements(Rayleigh(values[0] / ARCMIN / NMM_PER_NM**2)),
    needs=frozenset({LOOPS}),
)

EFFECTS = (PRESLIDING, RAYLEIGH)
