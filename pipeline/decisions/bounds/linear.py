"""A metric as a linear stack of the errors, and its process capability: whether a normal yield agrees with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from pipeline.arrays import Real
from pipeline.config.studies.study import Study
from pipeline.decisions.bounds.box import PHASES, Box, Evaluate
from pipeline.model.metrics import library
from pipeline.sampling.errors import deviations_at
from pipeline.statistics.intervals import Estimate, pass_share

QUANTILE_LEVEL = 0.9973
"""Level of the far quantile: three standard deviations of a normal distribution on both sides."""


@dataclass(frozen=True)
class Stack:
    """A metric linear in the errors about the middle of the box.

    Attributes
    ----------
    middle : its value there.
    parts : tolerance -> (n,) what its errors add in each of ``n`` drawn units.
    """

    middle: float
    parts: dict[str, Real]

    @property
    def values(self) -> Real:
        """(n,) of the drawn units."""
        return self.middle + np.sum(list(self.parts.values()), axis=0)

    @property
    def rss(self) -> float:
        """Standard deviation: root of the sum of the squares of what the independent tolerances cause."""
        return float(np.sqrt(sum(np.var(part, ddof=1) for part in self.parts.values())))

    @property
    def shares(self) -> dict[str, float]:
        """Share of the variance of each tolerance; missing where nothing varies."""
        total = self.rss**2
        return {name: float(np.var(part, ddof=1)) / total if total else np.nan for name, part in self.parts.items()}


def stack(study: Study, box: Box, evaluate: Evaluate, numbers: Real) -> Stack:
    """The linear stack of a metric, by secants over half of each zone, at drawn units.

    Parameters
    ----------
    evaluate : points of the box to the metric.
    numbers : (n, n_columns) of the unit cube, from which the study draws its errors, correlated as it says.
    """
    centre, columns = box.centre, box.columns
    points = [centre[None], box.flipped_points(centre, 0.25), box.flipped_points(centre, 0.75)]
    points += [box.rotated_points(centre, wave) for wave in box.all_waves]
    values = np.split(evaluate(np.concatenate(points)), np.cumsum([len(entry) for entry in points])[:-1])
    middle = float(values[0][0])
    slope = dict(zip(columns.tolist(), 2 * (values[2] - values[1]), strict=True))
    deviations, parts = deviations_at(study, numbers), {}
    for name, of_name in box.free_columns.items():
        steps = _share(study, name, deviations[name]) - 0.5
        parts[name] = steps @ np.array([slope[column] for column in of_name.tolist()])
    responses = iter(values[3:])
    for name, waves in box.waves.items():
        shares = _share(study, name, deviations[name]).T
        parts[name] = np.zeros(len(numbers))
        for (_, phase), share, response in zip(waves, shares, responses, strict=False):
            closed_response = np.append(response, response[0]) - middle
            parts[name] += share * np.interp(numbers[:, phase], np.arange(PHASES + 1) / PHASES, closed_response)
    return Stack(middle, parts)


def _share(study: Study, name: str, deviation: Real) -> Real:
    """Where deviations lie in their zone: 0 at the lower limit, 1 at the upper."""
    tolerance = getattr(study.tolerances, name)
    low, high = tolerance.limits_um
    return np.asarray((deviation - tolerance.allowance_um - low) / (high - low))


def statistics_of(metric: str, values: Real) -> dict[str, float]:
    """Mean, std, and the 99.73 % quantile on the bad side of values (n,)."""
    level = 1 - QUANTILE_LEVEL if library()[metric].smaller_is_worse else QUANTILE_LEVEL
    return {
        "mean": float(values.mean()),
        "std": float(values.std(ddof=1)),
        "far": float(np.quantile(values, level, method="median_unbiased")),
    }


@dataclass(frozen=True)
class Capability:
    """C_pk of a metric with one limit; C_p needs two, and no metric here has them.

    Attributes
    ----------
    cpk : distance of the mean from the limit over three standard deviations.
    yield_if_normal : share within the limit that it implies where the metric is normal.
    pass_estimate : the share of the samples.
    """

    metric: str
    mean: float
    std: float
    cpk: float
    yield_if_normal: float
    pass_estimate: Estimate

    @property
    def is_normal_plausible(self) -> bool:
        """Whether the yield of a normal distribution with this C_pk lies within the interval of the yield found."""
        return self.pass_estimate.ci_low <= self.yield_if_normal <= self.pass_estimate.ci_high


def capability(metric: str, values: NDArray[np.float64], limit: float, confidence: float) -> Capability:
    """C_pk of values (n,) against an upper limit, or a lower one where smaller is worse.

    Source
    ------
    ISO 22514-2:2017, Statistical methods in process management, clause 7: normally distributed characteristics.
    """
    sign = -1.0 if library()[metric].smaller_is_worse else 1.0
    mean, std = float(values.mean()), float(values.std(ddof=1))
    cpk = sign * (limit - mean) / (3 * std) if std > 0 else np.nan
    pass_estimate = pass_share(library()[metric].keeps(values, limit), confidence)
    return Capability(metric, mean, std, cpk, float(norm.cdf(3 * cpk)), pass_estimate)
