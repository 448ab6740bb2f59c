"""The yield of a run as its table of distributions tells it, and the units that would tell it better.

Nothing is drawn here: commands that ask for the yield alone do not wait for a plotting library.
"""

from collections.abc import Iterator

import pandas as pd

from pipeline.config.studies.study import ALL_LIMITS
from pipeline.statistics.intervals import Estimate, units_for_yield

HALF_WIDTHS = (0.02, 0.01, 0.005, 0.001)
"""Of the interval of a yield."""
MOSTLY_PRELOADED = 0.5
"""Share of preloaded units from which on a study says so first."""


def yield_estimate(distributions: pd.DataFrame, turn_value: str) -> Estimate | None:
    """Yield against all limits with its interval; None where no unit tells it.

    Parameters
    ----------
    distributions : table of ``aggregate``.
    turn_value : what the limits hold for: ``worst``, ``mean`` or ``best``.
    """
    key = {"metric": ALL_LIMITS, "over": turn_value, "statistic": "yield"}
    rows = distributions[(distributions[list(key)] == pd.Series(key)).all(axis=1)]
    for row in rows.itertuples():
        return Estimate(float(row.value), float(row.ci_low), float(row.ci_high), int(row.n))
    return None


def preload_warning(distributions: pd.DataFrame, turn_value: str) -> str:
    """A sentence where most units are preloaded, which a wrong sign or a missing allowance gives; else empty."""
    key = {"metric": "preloaded", "over": turn_value, "statistic": "mean"}
    share = distributions.loc[(distributions[list(key)] == pd.Series(key)).all(axis=1), "value"]
    if share.empty or share.iloc[0] < MOSTLY_PRELOADED:
        return ""
    return (
        f"{100 * share.iloc[0]:.3g} % of the units are preloaded: they have no clearance at some contact. Check the "
        "signs of the tolerances (python -m pipeline keys tolerances) and the allowances (allowance_um)."
    )


def needed_units(estimate: Estimate, confidence: float) -> list[tuple[float, int]]:
    """Half width of the interval of a yield, and the independent units that know it so well."""
    return [(width, units_for_yield(estimate.value, width, confidence)) for width in HALF_WIDTHS]


def needed_sentences(estimate: Estimate, confidence: float) -> Iterator[str]:
    """The same as lines of a summary."""
    for width, units in needed_units(estimate, confidence):
        yield f"for +-{100 * width:g} % on the yield against all limits take {units:,} independent units"
