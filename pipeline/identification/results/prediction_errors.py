"""Errors of predictions on held-out data of the metrics that are read off a loop."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pipeline import assembly
from pipeline.arrays import Index, Real
from pipeline.constant_kinds import Shown
from pipeline.identification.identify import Identification
from pipeline.model.metrics import LoopReadings, library, measurable_metrics

Numbers = Index

BEYOND: Shown = 0.05
"""Share of the largest torque by which a branch may be continued along its last cells, whose means end before it."""
SEPARATION = "branch_separation_arcmin"
"""Of the two branches at the lower torque of the rigidity, mean of both senses: no metric of a study."""
NO_LOSS = "a measured loop alone does not part friction from play; branch_separation_arcmin is friction alone"


@dataclass(frozen=True)
class LoopError:
    """A number read off the loops by one procedure, means over the loops that reach; why_not where none does."""

    measured_value: float | None = None
    predicted_values: Mapping[str, float] = field(default_factory=dict)
    loops: int = 0
    why_not: str = ""

    @classmethod
    def from_readings(cls, readings: Sequence[Mapping[str, float]], why_not: str) -> "LoopError":
        """Means of what was read off loops, measured and of each curve; of none the reason."""
        if not readings:
            return cls(why_not=why_not)
        mean = {name: float(np.mean([reading[name] for reading in readings])) for name in readings[0]}
        return cls(mean.pop("measured"), mean, len(readings))


def loop_errors(identification: Identification) -> dict[str, LoopError]:
    """The metrics that a measured loop has, and the separation of its branches: measured, and of each curve.

    Notes
    -----
    The centre line is the mean of the two branches. At zero torque a branch is continued from its second and third cell
    on that side, since the play may lie in the first.
    """
    curves = {"measured": identification.problem.data.angle} | identification.curves
    read: dict[str, list[dict[str, float]]] = {name: [] for name in (*measurable_metrics(), SEPARATION)}
    for loop in _loops(identification):
        of_curves = {name: _read(identification, loop, angle) for name, angle in curves.items()}
        for metric, complete in read.items():
            values = {name: numbers[metric] for name, numbers in of_curves.items()}
            if np.all(np.isfinite(list(values.values()))):
                complete.append(values)
    errors = {name: LoopError.from_readings(rows, _why_not(identification, name)) for name, rows in read.items()}
    return errors | {"hysteresis_loss_arcmin": LoopError(why_not=NO_LOSS)}


def _why_not(identification: Identification, metric: str) -> str:
    definitions = assembly.definitions(identification.measurement.unit.study)
    largest_torque = float(np.max(np.abs(identification.problem.data.torque)))
    torque = definitions.rigidity_low if metric == SEPARATION else library()[metric].largest_torque(definitions)
    return (
        f"asks for +-{torque:.3g} N m on both branches of a loop; the held-out loops reach {largest_torque:.3g} at most"
    )


def _loops(identification: Identification) -> list[tuple[Numbers, Numbers]]:
    """Cells of each falling branch, and of the rising ones that close it to a loop.

    Under positive load a cycle 0, +T, -T, 0 rises before it falls, any other one after it.
    """
    cells, torque, pairs = identification.measurement.cells, identification.measurement.cells.torque_mean, []
    blocks = [np.flatnonzero(cells.block == block) for block in np.unique(cells.block)]
    no_cells = np.zeros(0, np.intp)
    for number, falling in enumerate(blocks):
        if cells.direction[falling[0]] > 0:
            continue
        sides: list[Numbers] = []
        for neighbours in ((number + 1, number - 1), (number + 1,)):
            sense = 1 - 2 * len(sides)
            parts = [
                blocks[k][torque[blocks[k]] * sense > 0]
                for k in neighbours
                if 0 <= k < len(blocks) and cells.position[blocks[k][0]] == cells.position[falling[0]]
            ]
            sides.append(next((part for part in parts if len(part)), no_cells))
        rising = np.concatenate(sides)
        if identification.folds.cells[falling].all() and identification.folds.cells[rising].all():
            pairs.append((falling, rising))
    return pairs


def angle_of_branch(torque: Real, angle: Real, level: float) -> Real:
    """Angle of a branch (1,) at a torque ``level``, by its cells (n,) on that side of zero; NaN where it has too few.

    Cells at one torque, as of a staircase, count as their mean.
    """
    side = torque * np.sign(level) > 0
    x, number = np.unique(np.abs(torque[side]), return_inverse=True)
    y = np.bincount(number, angle[side]) / np.bincount(number)
    if len(x) < 3 or abs(level) > x[-1] + BEYOND * x[-1]:
        return np.full(1, np.nan)
    k = int(np.clip(np.searchsorted(x, abs(level)) - 1, 1 if abs(level) < x[1] else 0, len(x) - 2))
    return np.array([y[k] + (abs(level) - x[k]) * (y[k + 1] - y[k]) / (x[k + 1] - x[k])])


def _read(identification: Identification, loop: tuple[Numbers, Numbers], angle: Real) -> dict[str, float]:
    torque, study = identification.problem.data.torque, identification.measurement.unit.study
    definitions = assembly.definitions(study)
    mark, low, high = definitions.lost_motion, definitions.rigidity_low, definitions.rigidity_high
    falling, rising = loop

    def angle_at(branch: Numbers, level: float) -> Real:
        return angle_of_branch(torque[branch], angle[branch], level)

    tiny = 1e-9 * study.design.cycloid.rated_torque_Nm
    readings = LoopReadings.from_bench(
        zero_falling=angle_at(falling, tiny),
        zero_rising=angle_at(rising, -tiny),
        lost_motion_plus=0.5 * (angle_at(falling, mark) + angle_at(rising, mark)),
        lost_motion_minus=0.5 * (angle_at(falling, -mark) + angle_at(rising, -mark)),
        low_plus=angle_at(rising, low),
        high_plus=angle_at(rising, high),
        low_minus=angle_at(falling, -low),
        high_minus=angle_at(falling, -high),
    )
    with np.errstate(divide="ignore"):
        metrics = {name: float(metric.value(readings, definitions)[0]) for name, metric in measurable_metrics().items()}
    hysteresis = [float((angle_at(falling, end) - angle_at(rising, end))[0]) for end in (low, -low)]
    return metrics | {SEPARATION: 0.5 * sum(hysteresis)}
