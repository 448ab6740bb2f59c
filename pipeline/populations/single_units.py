"""Units that differ from the study by themselves, apart from the shift that all units share."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.arrays import Real
from pipeline.model.metrics import measurable_metrics
from pipeline.populations.comparison import metrics_at

LEVEL = 0.05
"""Probability that any unit of a sound population is named."""
FEWEST_UNITS = 3
"""Units of which a shared shift can be told from that of one unit."""
MEDIAN_VARIANCE = np.pi / 2
"""Variance of a median over that of the mean, of normal values."""


@dataclass(frozen=True)
class SingleUnits:
    """Units measured at one crank angle.

    Attributes
    ----------
    crank_deg : None for units without a crank angle.
    units : labels of the units with all metrics.
    p_value : (n_units,) of each unit against the study moved by the shift of the other units.
    fewest_samples : of the study with which one unit could be named.
    samples : of the study.
    has_noise : whether the repeatability of the bench is known.
    """

    crank_deg: float | None
    units: tuple[str, ...]
    p_value: Real
    fewest_samples: int
    samples: int
    has_noise: bool

    @property
    def outlying(self) -> tuple[str, ...]:
        """Units that are named, by Holm's procedure."""
        order = np.argsort(self.p_value)
        sentences = []
        for step, k in enumerate(order):
            if self.p_value[k] > LEVEL / (len(order) - step):
                break
            sentences.append(self.units[k])
        return tuple(sentences)

    @property
    def sentence(self) -> str:
        """Which units differ by themselves."""
        if len(self.units) < FEWEST_UNITS:
            return f"Fewer than {FEWEST_UNITS} units have all metrics, too few to distinguish one unit from the rest."
        if not self.has_noise:
            return (
                f"Whether a single unit differs from the {len(self.units)} units is not tested: that requires the "
                "bench's repeatability (--noise), which would otherwise count as a difference."
            )
        if self.samples < self.fewest_samples:
            return (
                f"Whether a single unit differs from the {len(self.units)} units is not tested: that requires "
                f"{self.fewest_samples:,} samples of the study, which has {self.samples:,}."
            )
        if not self.outlying:
            return (
                "No single unit differs from the others by more than the tolerances allow (5 % level over all units)."
            )
        return (
            f"Apart from the shift that all units share, these units differ individually: {', '.join(self.outlying)}. "
            "Measure their parts or their loops."
        )


def single_units(
    population: pd.DataFrame, metrics: pd.DataFrame, turn_statistic: str, noise: float | None
) -> list[SingleUnits]:
    """Each unit against the study, at each crank angle that the units name.

    Parameters
    ----------
    population, metrics, turn_statistic : as for ``metric_comparisons``.
    noise : standard deviation of a value of the bench over the value; None if it is not known: then no unit is tested.

    Notes
    -----
    The distance of a unit is Mahalanobis' in the covariance of the study's samples, from their mean moved by the
    median shift of all other units; p is the share of samples that lie as far from their mean. Each sample is given
    the noise of a bench, and the shift's own scatter is allowed for.
    """
    rng = np.random.default_rng(0)
    names = [name for name in measurable_metrics() if name in population and population[name].notna().any()]
    cranks = population["crank_deg"].to_numpy() if "crank_deg" in population else np.full(len(population), np.nan)
    groups = []
    for crank in [None] if np.isnan(cranks).all() else np.unique(cranks[np.isfinite(cranks)]):
        units_at_crank = population[np.isnan(cranks) if crank is None else cranks == crank]
        units_at_crank = units_at_crank.dropna(subset=names)
        samples = metrics_at(metrics, None if crank is None else float(crank), turn_statistic)[names].dropna()
        if noise:
            samples = samples * (1 + noise * rng.standard_normal(samples.shape))
        number = None if crank is None else float(crank)
        labels = units_at_crank["unit"].astype(str).tolist()
        groups.append(_at_crank(number, labels, units_at_crank[names], samples, noise is not None))
    return groups


def _at_crank(
    crank: float | None, labels: list[str], units: pd.DataFrame, samples: pd.DataFrame, has_noise: bool
) -> SingleUnits:
    values, reference = units.to_numpy(float), samples.to_numpy(float)
    fewest = int(np.ceil(len(labels) / LEVEL)) - 1
    if not has_noise or len(labels) < FEWEST_UNITS or len(reference) < fewest:
        return SingleUnits(crank, tuple(labels), np.ones(len(labels)), fewest, len(reference), has_noise)
    mean = reference.mean(axis=0)
    inverse = np.linalg.pinv(np.atleast_2d(np.cov(reference, rowvar=False)))
    shrink = 1 + MEDIAN_VARIANCE / (len(values) - 1)
    p_values = np.empty(len(values))
    spread = np.einsum("ij,jk,ik->i", reference - mean, inverse, reference - mean)
    for k, value in enumerate(values):
        shift = np.median(np.delete(values, k, axis=0), axis=0) - np.median(reference, axis=0)
        step = value - mean - shift
        p_values[k] = (1 + np.count_nonzero(spread >= step @ inverse @ step / shrink)) / (1 + len(reference))
    return SingleUnits(crank, tuple(labels), p_values, fewest, len(reference), has_noise)
