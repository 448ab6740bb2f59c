"""Process capability of a metric against its limit, and whether its normal yield agrees with the yield found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from pipeline.model.metrics import library
from pipeline.statistics import Estimate, pass_share


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
