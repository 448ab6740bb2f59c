"""How often the intervals of a study's statistics hold the truth: repeated experiments on the rigid play.

The rigid play is cheap and has what makes a metric hard to estimate: a hundred errors, of which those at the smallest
gaps count. The truth is a far larger Monte Carlo experiment of another seed.
"""

from dataclasses import astuple, dataclass
from typing import Literal

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from pipeline import assembly
from pipeline.arrays import Real
from pipeline.config.studies.study import Study
from pipeline.model.geometry.clearance import gaps
from pipeline.model.geometry.rigid_play.rigid_backlash import rigid_play
from pipeline.model.load_history.load_cycle import ARCMIN
from pipeline.sampling.designs import replicates
from pipeline.sampling.errors import draw
from pipeline.statistics.intervals import QUANTILES, Estimate, distribution, pass_share, share_interval

Experiment = Literal["monte_carlo", "sobol", "latin_hypercube"]

EXPERIMENTS: tuple[Experiment, ...] = ("monte_carlo", "sobol", "latin_hypercube")
COUNTS = (256, 1024)
"""Samples of an experiment: few in each replicate, and enough for quantiles of 1 %."""
CONFIDENCE = 0.95
"""Nominal coverage of the intervals that are counted."""
BATCH = 10_000
"""Samples of the reference that are drawn together."""
REFERENCE_BATCHES = 100
"""A million samples: the error of the truth is then some 3 % of the interval's half width at most."""
REFERENCE_SEED = 10**6
"""First seed of the reference; experiments count theirs from 0."""


@dataclass(frozen=True)
class Coverage:
    """How often one statistic's intervals hold the truth; ``ci`` is the exact binomial interval of that share.

    A yield is named after the quantile at which its limit stands. `bounded` is the share of the intervals that have an
    end at all.
    """

    experiment: str
    statistic: str
    n: int
    replicates: int
    repeats: int
    bounded: float
    coverage: float
    ci_low: float
    ci_high: float


def play(study: Study, experiment: Experiment, count: int, seed: int) -> tuple[Real, NDArray[np.integer] | None]:
    """Rigid backlash (count,) [arcmin] of an experiment at the study's first crank angle; each sample's replicate."""
    settings = {"experiment": experiment, "count": count, "seed": seed, "nominal_first": False}
    study = study.with_section("samples", **settings)
    reducer = assembly.reducer(study.design, study.cycle.crank_deg[0])
    sampled = draw(study, 0, count)
    gap = gaps(assembly.profile(study.design), reducer, assembly.errors(sampled), **dict(study.clearance))
    clearance = assembly.bearing_clearance(study.design, sampled.bearing_clearance)
    return ARCMIN * rigid_play(reducer, gap, clearance).backlash, replicates(study.samples, np.arange(count))


def reference(study: Study, batches: int = REFERENCE_BATCHES, jobs: int = 1) -> Real:
    """Rigid backlash of the reference, (batches * BATCH,)."""
    seeds = REFERENCE_SEED + np.arange(batches)
    parts = Parallel(jobs)(delayed(play)(study, "monte_carlo", BATCH, int(seed)) for seed in seeds)
    return np.concatenate([backlash for backlash, _ in parts])


def truths(values: Real) -> dict[str, float]:
    """True value of every statistic, from the reference."""
    levels = {name: float(np.quantile(values, level)) for name, level in QUANTILES.items()}
    shares = {f"yield at {name}": level for name, level in QUANTILES.items()}
    return {"mean": float(np.mean(values)), "std": float(np.std(values)), **levels, **shares}


def estimates(
    study: Study, experiment: Experiment, count: int, seed: int, truth: dict[str, float]
) -> dict[str, Estimate]:
    """Every statistic of one experiment, with its interval."""
    values, replicate = play(study, experiment, count, seed)
    shares = {f"yield at {name}": pass_share(values <= truth[name], CONFIDENCE, replicate) for name in QUANTILES}
    return distribution(values, CONFIDENCE, replicate) | shares


def coverages(
    study: Study, experiment: Experiment, count: int, repeats: int, truth: dict[str, float], jobs: int = 1
) -> list[Coverage]:
    """Coverage of every statistic over ``repeats`` experiments of the seeds 0, 1, ..."""
    runs = Parallel(jobs)(delayed(estimates)(study, experiment, count, seed, truth) for seed in range(repeats))
    parts = 1 if experiment == "monte_carlo" else study.samples.randomisations
    rows = []
    for name, exact in truth.items():
        low, high = np.array([(run[name].ci_low, run[name].ci_high) for run in runs]).T
        coverage = np.asarray((low <= exact) & (exact <= high), float)
        bounded = float(np.mean(np.isfinite(low) | np.isfinite(high)))
        interval = share_interval(coverage, CONFIDENCE)
        rows.append(Coverage(experiment, name, count, parts, repeats, bounded, float(np.mean(coverage)), *interval))
    return rows


def text(rows: list[Coverage]) -> str:
    """The rows as comma-separated text with a header."""
    lines = [",".join(Coverage.__dataclass_fields__), *(",".join(map(str, astuple(row))) for row in rows)]
    return "\n".join(lines) + "\n"
