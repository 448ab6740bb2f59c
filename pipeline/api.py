"""Studies and measured units from Python and notebooks, as the command line runs them."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from pipeline import config
from pipeline.cli import settings
from pipeline.cli.running import up_to_date
from pipeline.config import Study
from pipeline.engine.store import Output
from pipeline.errors import InputError


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

    @property
    def units(self) -> pd.DataFrame:
        """Worst, mean and best of every metric over the turn, one row a unit; the nominal reducer left out."""
        return self.table("aggregate/units").iloc[int(self.study.samples.nominal_first) :].reset_index(drop=True)

    @property
    def report(self) -> Path:
        """The page, if the stage ``report`` was asked for."""
        return self.folder / "report" / "report.html"


def load_study(name: str | Path) -> Study:
    """The study of a TOML file, or of its stem in data/studies.

    Raises
    ------
    InputError
        With everything that is wrong in the file and its design.
    """
    return config.load_study(name, settings.ROOT)


def run(study: Study | str | Path, stages: Sequence[str] = ("report",), jobs: int | None = None) -> Run:
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
    checked_study = study if isinstance(study, Study) else load_study(study)
    outputs = up_to_date(checked_study, stages, _options(jobs))
    return Run(outputs.study, settings.RUNS / checked_study.name, outputs.outputs)


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


def identify(unit: str | Path, jobs: int | None = None) -> dict[str, Any]:
    """Why a measured unit differs from its model: the content of ``verdict.json``.

    Parameters
    ----------
    unit : folder with a ``unit.toml``, or the name of one in data/measured.

    Raises
    ------
    InputError
        If the folder or its data cannot be read.
    """
    from pipeline.cli.identify import identify_unit  # its imports take as long as all others together

    options = _options(jobs)
    options.unit, options.series = str(unit), ""
    identify_unit(options)
    return json.loads((settings.RUNS / "identify" / Path(unit).name / "verdict.json").read_text())


def identify_series(folder: str | Path, over: str = "") -> dict[str, Any]:
    """What several states of one drive share, and how each differs: the content of ``verdict.json``.

    Parameters
    ----------
    folder : has a folder with a ``unit.toml`` for each state.
    over : variable of ``[state]`` that orders them; by default the first that all have.

    Raises
    ------
    InputError
        If the folder or its data cannot be read, or the states cannot be compared.
    """
    from pipeline.cli.measured import identify_series as identify  # its imports take as long as all others together

    options = _options(None)
    options.series, options.over = str(folder), over
    identify(options)
    return json.loads((settings.RUNS / "series" / Path(folder).resolve().name / "verdict.json").read_text())


def _options(jobs: int | None) -> argparse.Namespace:
    return argparse.Namespace(jobs=jobs, backend="loky", scheduler=None, open_scheduler=False)
