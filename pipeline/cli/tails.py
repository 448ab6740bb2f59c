"""The command of a study's far tails: its stage, with the numbers of units that are typed or that the study states."""

import argparse

import pandas as pd

from pipeline.cli import settings
from pipeline.cli.running import up_to_date
from pipeline.config import load_study
from pipeline.config.studies.tails import Tails, without_tails
from pipeline.engine.store import write_atomic
from pipeline.errors import InputError


def find_tails(options: argparse.Namespace) -> None:
    """Write shares beyond the limits and far quantiles of a study."""
    study = load_study(options.study, settings.ROOT)
    if reason := without_tails(study.samples, study.limits):
        raise InputError(f"study {study.name}: {reason}")
    tail_settings = study.tails or Tails()
    typed = {"units": options.units or tail_settings.units, "solve": options.solve or tail_settings.solve}
    if not 0 < typed["solve"] <= typed["units"]:
        raise InputError(f"--solve = {typed['solve']}; must be from 1 to --units = {typed['units']}")
    asked_study = study.model_copy(update={"tails": tail_settings.model_copy(update=typed)})
    rows = pd.DataFrame(up_to_date(asked_study, ["tails"], options).outputs["tails"].read("tails"))
    table = settings.RUNS / "tails" / f"{study.name}.csv"
    write_atomic(table, rows.to_csv(index=False).encode())
    print(rows.to_string(index=False, float_format=lambda value: f"{value:.6g}"))
    print(f"table: {settings.shown(table)}")
