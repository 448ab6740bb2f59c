"""Which errors drive a metric, in words: the leading indices whose intervals exclude 0."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.figures.labels import METRICS, parameter_title
from pipeline.figures.sensitivity import REMAINDER
from pipeline.model.metrics import signed
from pipeline.report.frames import HEADLINES, Frames
from pipeline.report.wording import NOTHING, UNDETERMINED, percent

NAMED = 3
NONE_LEADS = "none stands out"


@dataclass(frozen=True)
class Driver:
    """What drives one metric: the first error, the leading ones by each index, and the share that none carries."""

    metric: str
    title: str
    first: str
    by_share: str
    by_rank: str
    rest: str


def drivers(frames: Frames) -> list[Driver]:
    """For each metric the errors that drive it most, as far as the samples tell."""
    table = frames.sensitivity
    return [_driver(metric, table[table["metric"] == metric]) for metric in frames.shown_metrics]


def first_drivers(found: Sequence[Driver]) -> str:
    """The first driver of each headline metric, in one phrase."""
    return "; ".join(
        f"of the {METRICS[driver.metric].inline}: {driver.first}" for driver in found if driver.metric in HEADLINES
    )


def shares_determined(frames: Frames) -> bool:
    """Whether the samples are enough for variance shares."""
    return len(_known(frames.sensitivity, "variance_share")) > 0


def constant_metrics(frames: Frames) -> list[str]:
    """Metrics that do not vary over the samples, which therefore nothing drives."""
    constant = np.ptp(frames.worst[frames.shown_metrics].to_numpy(), axis=0) == 0 if len(frames.worst) else ()
    return [METRICS[name].inline for name, same in zip(frames.shown_metrics, constant, strict=False) if same]


def _driver(metric: str, table: pd.DataFrame) -> Driver:
    shares, ranks = (_leading(table, kind) for kind in ("variance_share", "rank_correlation"))
    if shares:
        first = f"{shares[0][0]}, {percent(shares[0][1])} of the variance"
    else:
        first = f"{ranks[0][0]}, rank correlation {signed(ranks[0][1], 2)}" if ranks else NONE_LEADS
    rest = table.loc[table["parameter"] == REMAINDER, "index"]
    return Driver(
        metric,
        METRICS[metric].title,
        first,
        "; ".join(f"{name} ({percent(share)})" for name, share in shares) or _no_leader(table, "variance_share"),
        "; ".join(f"{name} ({signed(rank, 2)})" for name, rank in ranks) or _no_leader(table, "rank_correlation"),
        percent(float(rest.iloc[0])) if len(rest) else NOTHING,
    )


def _known(table: pd.DataFrame, kind: str) -> pd.DataFrame:
    """Determined indices of the errors, of one kind."""
    rows = table[(table["kind"] == kind) & (table["parameter"] != REMAINDER)]
    return rows[np.isfinite(rows["index"].to_numpy(float))]


def _leading(table: pd.DataFrame, kind: str) -> list[tuple[str, float]]:
    """Errors with the largest indices, largest first, as far as their intervals exclude 0."""
    known = _known(table, kind)
    # a share below 0 is noise, however narrow its interval
    clear = known[(known["ci_low"] > 0) | ((known["ci_high"] < 0) & (kind == "rank_correlation"))]
    first = clear.sort_values("index", ascending=False, kind="stable", key=np.abs).head(NAMED)
    return [
        (parameter_title(name), float(index)) for name, index in zip(first["parameter"], first["index"], strict=True)
    ]


def _no_leader(table: pd.DataFrame, kind: str) -> str:
    return NONE_LEADS if len(_known(table, kind)) else UNDETERMINED
