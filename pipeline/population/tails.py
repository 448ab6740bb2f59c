"""Yields of parts per million and the 99.73 % quantile of a study: rigid play decides which units are load-solved.

Every unit's rigid play is cheap; its metrics under load are not. A pilot of other units tells how a metric follows from
the play, and how far it strays; by that the units are taken (``statistics.two_phase``). A metric that the play does not
tell gets units taken nearly alike, and its interval is then as wide as that of plain sampling: ``effective`` says so.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping
from dataclasses import astuple, dataclass, fields, replace

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from pipeline import assembly
from pipeline.config.study import Study
from pipeline.errors import InputError
from pipeline.model.geometry.rigid_backlash import rigid_play
from pipeline.model.load_history.load_cycle import ARCMIN
from pipeline.model.metrics import library
from pipeline.mounting import drive_of
from pipeline.sampling import Errors, draw
from pipeline.statistics.replicated import FEWEST_BEYOND
from pipeline.statistics.two_phase import (
    exceedance_chance,
    inclusion_probability,
    tail_quantile,
    tail_share,
)

Real = NDArray[np.float64]
Solve = Callable[[Errors], Mapping[str, Real]]
"""Errors of ``n`` units to each metric over the turn (n,), missing where there is no equilibrium."""

LEVEL = 0.9973
"""Quantile of the far tail: three standard deviations of a normal distribution on both sides."""
PILOT = 500
"""Units that are solved beforehand and count in no estimate: the slope to a few percent, the scatter to 3 %."""
BATCH = 500
"""Units that are drawn and solved together."""
LEAST_SCATTER = 1e-3
"""Scatter about the prediction that is assumed at least, in units of the metric's spread."""
SELECTION = 2**31
"""Key of the random numbers by which units are taken, beside those of their errors."""


@dataclass(frozen=True)
class TailRow:
    """One row of ``tails.csv``: a statistic of ``units`` units of which ``solved`` have been load-solved.

    ``effective`` units, all solved, would know it as well. A share is that of the units beyond the limit.
    """

    metric: str
    statistic: str
    value: float
    ci_low: float
    ci_high: float
    units: int
    solved: int
    effective: float


@dataclass(frozen=True)
class Tail:
    """A metric whose far tail is asked for; `sign` makes large values the bad ones."""

    metric: str
    sign: float
    limit: float

    def bad(self, values: Mapping[str, Real]) -> Real:
        """Values (n,), the larger the worse."""
        return self.sign * values[self.metric]


def tails_of(study: Study) -> tuple[Tail, ...]:
    """The metrics that have a limit, but for those that rigid bodies tell: their units need no load.

    Raises
    ------
    InputError
        If there is none, or the samples are listed cases.
    """
    if study.samples.experiment == "cases":
        raise InputError(f"study {study.name}: listed cases are no sample of anything; tails need random samples")
    found = []
    for name, limit in study.limits.of_metrics.items():
        sign = -1.0 if library()[name].smaller_is_worse else 1.0
        if not library()[name].turn_of_rigid_bodies:
            found.append(Tail(name, sign, sign * limit))
    if not found:
        raise InputError(f"study {study.name}: [limits] names no metric under load; set one, as lost_motion_arcmin")
    return tuple(found)


def population(study: Study, units: int) -> Study:
    """The study with so many independent units, and the pilot's behind them."""
    samples = {"count": units + PILOT, "experiment": "monte_carlo", "nominal_first": False}
    return study.model_copy(update={"samples": study.samples.model_copy(update=samples)})


def worst_play(study: Study, sampled: Errors) -> Real:
    """Largest rigid backlash (n,) [arcmin] over the loaded crank angles."""
    errors = assembly.errors(sampled)
    clearance = assembly.bearing_clearance(study.design, sampled.bearing_clearance)
    worst = np.full(len(sampled), -np.inf)
    for crank in study.cycle.crank_deg:
        drive = drive_of(study, crank, None, errors, clearance)
        worst = np.maximum(worst, ARCMIN * rigid_play(drive.reducer, drive.gap, drive.bearing_clearance).backlash)
    return worst


@dataclass(frozen=True)
class Prediction:
    """How bad the units of phase 1 are taken to be, the larger the worse.

    Attributes
    ----------
    value : (n_units,) on a line over the rigid play, fitted to the pilot.
    missed : (n_pilot,) what the line misses of the pilot.
    scale : typical size of it.
    limits : of the share beyond, and where the far quantile is expected.
    """

    value: Real
    missed: Real
    scale: float
    limits: tuple[float, float]

    @classmethod
    def fitted(cls, tail: Tail, play: Real, pilot_play: Real, pilot: Mapping[str, Real]) -> Prediction:
        """From the rigid play of the units, and of the pilot whose metrics are known."""
        values = tail.bad(pilot)
        known = np.isfinite(values)
        line = np.polynomial.Polynomial.fit(pilot_play[known], values[known], 1)
        missed = values[known] - line(pilot_play[known])
        scale = max(float(np.std(missed, ddof=2)), LEAST_SCATTER * float(np.std(values[known])))
        value = line(play)
        quantile = float(np.quantile(value + np.resize(missed, play.size), LEVEL))
        return cls(value, missed, scale, (tail.limit, quantile))

    @property
    def demand(self) -> Real:
        """(n_units,) by whose root a unit is to be taken: chance q beyond a limit over its mean p squared, summed.

        The relative variance of a share is the sum of (q/p^2)/probability, so what several tails ask for adds up.
        """
        chance = np.stack([exceedance_chance(self.value, limit, self.scale) for limit in self.limits])
        return np.asarray(np.sum(chance / np.mean(chance, axis=1)[:, None] ** 2, axis=0))

    def expected(self, probability: Real) -> list[float]:
        """Independent units beyond each limit that the taken ones are worth, if all units miss as the pilot does.

        (sum q)^2 / sum(q/probability) with the chance q of a unit, the share of the pilot's misses that would do.
        """
        order = np.argsort(self.value)
        weight = np.append(np.cumsum(1 / probability[order][::-1])[::-1], 0.0)
        found = []
        for limit in self.limits:
            first = np.searchsorted(self.value[order], limit - self.missed, side="right")
            beyond, weights = np.mean(self.value.size - first), np.mean(weight[first])
            found.append(float(beyond**2 / weights) if weights > 0 else 0.0)
        return found


def far_tails(study: Study, units: int, budget: int, solve: Solve, jobs: int = 1) -> list[TailRow]:
    """Share beyond the limit and far quantile of every metric under load that has a limit.

    Parameters
    ----------
    units : whose rigid play is looked at.
    budget : units that are load-solved on average, besides the pilot.
    solve : metrics of units over the turn.
    """
    tails, many = tails_of(study), population(study, units)
    starts = range(0, units, BATCH)
    play = np.concatenate(Parallel(jobs)(delayed(_play)(many, a, min(a + BATCH, units)) for a in starts))
    pilot = draw(many, units, units + PILOT)
    pilot_play, pilot_metrics = worst_play(many, pilot), solve(pilot)
    predictions = [Prediction.fitted(tail, play, pilot_play, pilot_metrics) for tail in tails]
    probability = inclusion_probability(np.sum([one.demand for one in predictions], axis=0), budget)
    rng = np.random.default_rng(np.random.SeedSequence(study.samples.seed, spawn_key=(SELECTION,)))
    taken = np.flatnonzero(rng.random(units) < probability)
    parts = Parallel(jobs)(delayed(_solved)(many, solve, taken[a : a + BATCH]) for a in range(0, taken.size, BATCH))
    values = {tail.metric: np.concatenate([part[tail.metric] for part in parts]) for tail in tails}
    rows = []
    for tail, prediction in zip(tails, predictions, strict=True):
        expected = prediction.expected(probability)
        rows += _rows(tail, tail.bad(values), probability[taken], units, study.metrics.confidence, expected)
    return rows


def text(rows: list[TailRow]) -> str:
    """The rows as comma-separated text with a header."""
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    table.writerow([field.name for field in fields(TailRow)])
    table.writerows(astuple(row) for row in rows)
    return out.getvalue()


def _play(study: Study, start: int, stop: int) -> Real:
    return worst_play(study, draw(study, start, stop))


def _solved(study: Study, solve: Solve, taken: NDArray[np.intp]) -> Mapping[str, Real]:
    """Metrics of the taken units; each is drawn by its own number."""
    drawn = [draw(study, int(unit), int(unit) + 1) for unit in taken]
    together = {name: np.concatenate([getattr(one, name) for one in drawn]) for name in vars(drawn[0])}
    return solve(Errors(**together))


def _rows(
    tail: Tail, bad: Real, probability: Real, units: int, confidence: float, expected: list[float]
) -> list[TailRow]:
    """Share and quantile of one metric; units without equilibrium, and those that they stand for, are left out.

    An estimate that may expect too few units beyond has no interval: its spread does not show what was missed.
    """
    known = np.isfinite(bad)
    units -= round(float(np.sum(1 / probability[~known])))
    share = tail_share(bad[known] > tail.limit, probability[known], units, confidence)
    quantile = tail_quantile(bad[known], probability[known], units, LEVEL, confidence)
    if expected[0] < FEWEST_BEYOND:
        share = replace(share, ci_low=0.0, ci_high=1.0)
    if expected[1] < FEWEST_BEYOND:
        quantile = replace(quantile, ci_low=-np.inf, ci_high=np.inf)
    low, high = sorted((tail.sign * quantile.ci_low, tail.sign * quantile.ci_high))
    quantile = replace(quantile, value=tail.sign * quantile.value, ci_low=low, ci_high=high)
    name = f"p{100 * LEVEL:.2f}" if tail.sign > 0 else f"p{100 * (1 - LEVEL):.2f}"
    return [TailRow(tail.metric, kind, *astuple(one)) for kind, one in (("beyond", share), (name, quantile))]
