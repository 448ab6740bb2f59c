"""Designs, studies and their runs."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from pipeline import config, settings
from pipeline.config import Design, Study
from pipeline.config.studies.optional import Tails, limited_under_load, without_tails
from pipeline.engine.store import Output, write_atomic
from pipeline.errors import InputError
from pipeline.figures.labels import METRICS
from pipeline.library.running import Answer, Workers, study_of, up_to_date

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


def tail_remarks(rows: pd.DataFrame, study: Study) -> Iterator[str]:
    """Which crank angles the rows of the table `tails` count, and which units and limits they do not."""
    level = f"{100 * study.metrics.confidence:.3g} %"
    yield f"For the {study.limits.over} value over {len(study.cycle.crank_deg)} loaded crank angles; {level} intervals"
    units = study.tails.units if study.tails else 0
    if missing := units - int(rows["units"].min()):
        yield (
            f"About {missing:,} of {units:,} units have no result (the model is not valid for them, or no state was "
            f"found) and count nowhere; if they all failed, {MILLION * missing / units:,.0f} units in a million would "
            "be added to the shares beyond each limit"
        )
    covered_limits = limited_under_load(study.limits)
    for name in (name for name in study.limits.of_metrics if name not in covered_limits):
        yield (
            f"The limit of {METRICS[name].inline if name in METRICS else name} is not among these: it is read over the "
            "whole turn without load; its yield is in the report of the study"
        )


@dataclass(frozen=True)
class Run:
    """A finished run: its folder, and its tables as frames."""

    study: Study
    folder: Path
    outputs: Mapping[str, Output]

    def table(self, name: str) -> pd.DataFrame:
        """A table by stage and name, as ``"aggregate/units"``.

        Raises
        ------
        InputError
            If its file is damaged.
        KeyError
            If the stage was not asked for.
        """
        stage, _, table = name.partition("/")
        return pd.DataFrame(self.outputs[stage].read(table))

    def to_frame(self) -> pd.DataFrame:
        """The units, as ``units``."""
        return self.units

    @property
    def units(self) -> pd.DataFrame:
        """Worst, mean and best of every metric over the turn, one row a unit; the nominal reducer left out."""
        return self.table("aggregate/units").iloc[int(self.study.samples.nominal_first) :].reset_index(drop=True)

    @property
    def report(self) -> Path:
        """The page, if the stage ``report`` was asked for."""
        return self.folder / "report" / "report.html"


def load_design(name: str | Path) -> Design:
    """The design of a TOML file, or of its stem in data/designs.

    Raises
    ------
    InputError
        With everything that is wrong in the file.
    """
    return config.load_design(name, settings.ROOT)


def load_study(name: str | Path) -> Study:
    """The study of a TOML file, or of its stem in data/studies.

    Raises
    ------
    InputError
        With everything that is wrong in the file and its design.
    """
    return config.load_study(name, settings.ROOT)


def run(study: Study | str | Path, stages: Sequence[str] = ("report",), jobs: int | Workers | None = None) -> Run:
    """Bring stages of a study up to date and return its tables.

    Parameters
    ----------
    study : or the name or file of one.
    stages : wanted; what they depend on runs too where it is missing or stale.
    jobs : processes; the study's own number if not given.

    Raises
    ------
    InputError
        If a file or a setting is wrong, or another process writes the run.
    """
    outputs = up_to_date(study_of(study), stages, jobs)
    return Run(outputs.study, settings.RUNS / outputs.study.name, outputs.outputs)


def parts(run_folder: str | Path, table: str) -> list[str]:
    """Parquet files of a table of a run, as ``"hysteresis/contacts"``: those that its record names, and no others.

    Raises
    ------
    InputError
        If the run has no such table.
    """
    stage, _, name = table.partition("/")
    output = Output.open(Path(run_folder) / stage)
    if output is None or name not in output.record["tables"]:
        raise InputError(f"{run_folder}: no table {table}; run its stage")
    return [str(path) for path in output.parts(name)]


def tails(
    study: Study | str | Path, units: int | None = None, solve: int | None = None, jobs: int | Workers | None = None
) -> Answer[Study]:
    """Shares beyond the limits and far quantiles of a study.

    Parameters
    ----------
    study : or the name or file of one.
    units : looked at by a rough model; the study's own number, or 100,000, if not given.
    solve : of them load-solved on average; the study's own number, or 4,000, if not given.
    jobs : processes; the study's own number if not given.

    Raises
    ------
    InputError
        If the study has no limits that units may break, or a number is wrong.
    """
    study = study_of(study)
    if reason := without_tails(study.samples, study.limits):
        raise InputError(f"study {study.name}: {reason}")
    of_study = study.tails or Tails()
    numbers = {"units": of_study.units if units is None else units, "solve": of_study.solve if solve is None else solve}
    if not 0 < numbers["solve"] <= numbers["units"]:
        raise InputError(f"--solve = {numbers['solve']}; must be from 1 to --units = {numbers['units']}")
    asked_study = study.model_copy(update={"tails": of_study.model_copy(update=numbers)})
    rows = pd.DataFrame(up_to_date(asked_study, ["tails"], jobs).outputs["tails"].read("tails"))
    table = settings.RUNS / "tails" / f"{study.name}.csv"
    write_atomic(table, rows.to_csv(index=False).encode())
    lines = (*tail_remarks(rows, asked_study), *tail_sentences(rows), f"table: {settings.shown(table)}")
    return Answer(asked_study, lines, table.parent, {"tails": rows}, page="")
