"""Units for variance-based indices: two independent sets, and the first with one group's errors from the second.

A group is a toleranced dimension with all its elements: the radial errors of all pins however they are correlated along
the circle, or an ovality's amplitude with its phase. Groups are independent, since each has dimensions of the unit cube
of its own and errors are correlated within a tolerance only. That is what makes shares of the variance meaningful.
"""

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Real
from pipeline.config.studies.study import Study
from pipeline.sampling.designs import independent_uniforms
from pipeline.sampling.errors import Errors, dimensions, errors_at, varies

SETS = 2
"""Base sets: the one whose errors are replaced, and the one that they are taken from."""


def error_groups(study: Study) -> tuple[str, ...]:
    """Tolerances that vary from unit to unit, by name; an ovality of fixed amplitude varies by its phase."""
    return tuple(name for name, _ in study.tolerances if varies(study, name))


def drawn_units(study: Study) -> int:
    """How many units of the design, from the first on, are samples of the study itself.

    Notes
    -----
    The sets are the first draws of a Monte Carlo study with this seed. Points of a Sobol' sequence or a hypercube
    depend on each other, which the two sets must not; such a study shares no unit.
    """
    samples = study.samples
    return min(SETS * study.drivers.base_samples, samples.count) if samples.experiment == "monte_carlo" else 0


def draw_mixed(study: Study, start: int, stop: int) -> Errors:
    """Errors of the units [start, stop) of the pick-freeze design.

    Parameters
    ----------
    study : its tolerances, design, seed and ``drivers.base_samples`` (n).
    start, stop : first unit, and the one after the last. Units 0 to n - 1 are the base set, the next n the other set,
        then n units per group of `error_groups` in their order. Unit k is the same however the units are divided.
    """
    n, sizes = study.drivers.base_samples, dimensions(study)
    ends = dict(zip(sizes, np.cumsum(list(sizes.values())), strict=True))
    part, row = np.divmod(np.arange(start, stop), n)
    numbers = [np.empty((0, sum(sizes.values())))]
    for k in np.unique(part):
        rows = row[part == k]
        base, second_base = (_numbers(study, sum(sizes.values()), rows + shift) for shift in (0, n))
        if k >= SETS:
            group = error_groups(study)[k - SETS]
            for name in {group, f"{group}_phase"} & set(sizes):
                columns = slice(ends[name] - sizes[name], ends[name])
                base[:, columns] = second_base[:, columns]
        numbers.append(second_base if k == 1 else base)
    return errors_at(study, np.concatenate(numbers))


def _numbers(study: Study, columns: int, draws: NDArray[np.integer]) -> Real:
    return independent_uniforms(study.samples.seed, columns, int(draws[0]), int(draws[-1]) + 1)
