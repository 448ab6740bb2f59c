"""How bad the units of a study are, foretold from a model that costs a fraction of the loaded one.

The rough model has the exact gaps of a unit and its rigid play, and lets every contact give way by itself
(``load_history.winkler``). At each loaded crank angle a metric is taken to be linear in the rough model's metrics, by
a pilot of units whose metrics under load are known; over the turn it is then judged as the limits judge it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline import assembly
from pipeline.arrays import Real
from pipeline.config.studies.study import Study
from pipeline.model.load_history.winkler import winkler_readings
from pipeline.model.metrics import library
from pipeline.mounting import drive_of
from pipeline.sampling.errors import Errors
from pipeline.statistics.two_phase import exceedance_chance

LEVEL = 0.9973
"""Quantile of the far tail: three standard deviations of a normal distribution on both sides."""
LEAST_SCATTER = 1e-3
"""Scatter about the prediction that is assumed at least, in units of the metric's spread."""


@dataclass(frozen=True)
class Tail:
    """A metric whose far tail is asked for, `turn_statistic` the turn; `sign` makes large values the bad ones."""

    metric: str
    turn_statistic: str
    sign: float
    limit: float

    def over_turn(self, turn: Real) -> Real:
        """Values (n,), the larger the worse, of the metric at the loaded crank angles (n, n_angles)."""
        worst_value, best_value = library()[self.metric].over_turn(turn)
        return np.asarray(
            self.sign * {"worst": worst_value, "best": best_value, "mean": turn.mean(axis=1)}[self.turn_statistic]
        )


def rough_metrics(study: Study, compliances: Sequence[Real], sampled_errors: Errors) -> Mapping[str, Real]:
    """Metrics (n, n_angles) of units on independent springs.

    Parameters
    ----------
    compliances : of the springs (n_contacts,) [mm/N] at each loaded crank angle.
    """
    errors, definitions = assembly.errors(sampled_errors), assembly.definitions(study)
    clearance = assembly.bearing_clearance(study.design, sampled_errors.bearing_clearance)
    readings = [
        winkler_readings(drive_of(study, crank, None, errors, clearance), compliance, definitions)
        for crank, compliance in zip(study.cycle.crank_deg, compliances, strict=True)
    ]
    return {
        name: np.stack([metric.values(reading, definitions) for reading in readings], axis=1)
        for name, metric in library().items()
    }


def predicted_turn(loaded_values: Real, pilot: Mapping[str, Real], units: Mapping[str, Real]) -> tuple[Real, Real]:
    """A metric under load of the pilot and of the units (n, n_angles), by least squares at each crank angle.

    Parameters
    ----------
    loaded_values : (n_pilot, n_angles), what it is of the pilot.
    pilot, units : all rough metrics (n, n_angles), in which it is taken to be linear.
    """
    samples = [np.stack([np.ones_like(loaded_values), *pilot.values()], axis=2)]
    samples.append(np.stack([np.ones_like(next(iter(units.values()))), *units.values()], axis=2))
    finite = np.all(np.isfinite(loaded_values) & np.all(np.isfinite(samples[0]), axis=2), axis=1)
    slopes = [
        np.linalg.lstsq(samples[0][finite, angle], loaded_values[finite, angle], rcond=None)[0]
        for angle in range(loaded_values.shape[1])
    ]
    of_pilot, of_units = (np.einsum("nam,am->na", metrics, np.stack(slopes)) for metrics in samples)
    return of_pilot, of_units


@dataclass(frozen=True)
class TailPrediction:
    """How bad the units of phase 1 are taken to be, the larger the worse.

    Attributes
    ----------
    value : (n_units,) on a line over what the rough metrics tell, fitted to the pilot.
    prediction_errors : (n_pilot,) what the line misses of the pilot.
    scale : typical size of it.
    limits : of the share beyond, and where the far quantile is expected.
    """

    value: Real
    prediction_errors: Real
    scale: float
    limits: tuple[float, float]

    @classmethod
    def from_pilot(
        cls, tail: Tail, loaded_values: Real, pilot: Mapping[str, Real], units: Mapping[str, Real]
    ) -> "TailPrediction":
        """From the rough metrics of the units, and of the pilot whose metric under load is known (n, n_angles)."""
        rough, of_units = (tail.over_turn(turn) for turn in predicted_turn(loaded_values, pilot, units))
        values = tail.over_turn(loaded_values)
        finite = np.isfinite(values) & np.isfinite(rough)
        line = np.polynomial.Polynomial.fit(rough[finite], values[finite], 1)
        prediction_errors = values[finite] - line(rough[finite])
        scale = max(float(np.std(prediction_errors, ddof=2)), LEAST_SCATTER * float(np.std(values[finite])))
        value = np.where(np.isfinite(of_units), line(of_units), tail.limit)  # what no rough model tells is looked at
        quantile = float(np.quantile(value + np.resize(prediction_errors, value.size), LEVEL))
        return cls(value, prediction_errors, scale, (tail.limit, quantile))

    @property
    def chance_beyond(self) -> Real:
        """Chance (n_units,) of each unit to lie beyond the limit."""
        return exceedance_chance(self.value, self.limits[0], self.scale)

    @property
    def demand(self) -> Real:
        """(n_units,) by whose root a unit is to be taken: chance q beyond a limit over its mean p squared, summed.

        The relative variance of a share is the sum of (q/p^2)/probability, so what several tails ask for adds up.
        """
        chance = np.stack([exceedance_chance(self.value, limit, self.scale) for limit in self.limits])
        return np.asarray(np.sum(chance / np.mean(chance, axis=1)[:, None] ** 2, axis=0))

    def effective_counts(self, probability: Real) -> list[float]:
        """Independent units beyond each limit that the taken ones are worth, if all units miss as the pilot does.

        (sum q)^2 / sum(q/probability) with the chance q of a unit, the share of the pilot's misses that would do.
        """
        order = np.argsort(self.value)
        weight = np.append(np.cumsum(1 / probability[order][::-1])[::-1], 0.0)
        numbers = []
        for limit in self.limits:
            rank = np.searchsorted(self.value[order], limit - self.prediction_errors, side="right")
            share, weights = np.mean(self.value.size - rank), np.mean(weight[rank])
            numbers.append(float(share**2 / weights) if weights > 0 else 0.0)
        return numbers
