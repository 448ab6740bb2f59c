"""Hysteresis of soft parts that does not depend on the rate."""

from collections.abc import Sequence
from dataclasses import replace

from pipeline.model.effects.effect import LOOPS, Conditions, Effect, Parameter, largest_twist
from pipeline.model.load_history.drive import Drive
from pipeline.model.units import ARCMIN, NMM_PER_NM


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    return replace(drive, rayleigh=drive.rayleigh + values[0] / ARCMIN / NMM_PER_NM**2)


EFFECT = Effect(
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
    apply=_apply,
    needs=frozenset({LOOPS}),
)
