"""The answer of the command `tails` in words."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pandas as pd

from pipeline.figures.labels import METRICS

MILLION = 1_000_000
"""Units that a share beyond a limit is stated of."""
NO_INTERVAL = "no interval: too few failing units are expected; raise --units and --solve"


def tail_sentences(rows: pd.DataFrame) -> Iterator[str]:
    """One sentence for each share beyond a limit and each far quantile, with its interval.

    Parameters
    ----------
    rows : of the table `tails`.
    """
    for row in rows.itertuples():
        metric = METRICS[str(row.metric)]
        effective = f"effective sample size {row.effective:,.0f}"
        if row.statistic == "beyond":
            shares = (row.value, row.ci_low, row.ci_high)
            value, low, high = (f"{float(f'{MILLION * share:.3g}'):,.0f}" for share in shares)
            is_known = (row.ci_low, row.ci_high) != (0.0, 1.0)
            text = f"{metric.title}: {value} units in a million are beyond the limit"
        else:
            value, low, high = (f"{float(f'{end:.4g}'):,.10g}" for end in (row.value, row.ci_low, row.ci_high))
            is_known = math.isfinite(row.ci_low) or math.isfinite(row.ci_high)
            text = f"{metric.title}: the {str(row.statistic).removeprefix('p')} % quantile is {value} {metric.unit}"
        yield f"{text} ({f'interval {low} to {high}' if is_known else NO_INTERVAL}; {effective})"
