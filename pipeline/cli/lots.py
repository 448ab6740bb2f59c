"""Commands on measured parts: the yield of lots."""

import argparse
from functools import partial
from pathlib import Path

import pandas as pd

from pipeline.cli import settings
from pipeline.cli.decisions import DESIGN_FILE, loaded_units
from pipeline.cli.running import up_to_date
from pipeline.config import load_study
from pipeline.config.files.text_file import check_text, header
from pipeline.config.files.writing import toml_of
from pipeline.config.studies.study import Study
from pipeline.decisions.lots import results
from pipeline.decisions.lots.measured_lot import MeasuredLot, measured_lot
from pipeline.engine.cache import Cache
from pipeline.engine.stage import Job
from pipeline.engine.store import write_atomic
from pipeline.errors import InputError
from pipeline.report.decisions.lots import sentences, write_lots_page
from stages import hysteresis

MOST_LOTS = 2


def judge_lots(options: argparse.Namespace) -> None:
    """Fit the distributions of measured lots and solve the yield of a study made from them."""
    if options.units < 1:
        raise InputError(f"--units = {options.units}; must be at least 1")
    if len(options.csv) > MOST_LOTS:
        raise InputError(f"--csv given {len(options.csv)} times; at most {MOST_LOTS} lots are compared")
    study = load_study(options.study, settings.ROOT)
    lots = [read_lot(path, study) for path in options.csv]
    for lot in lots:
        results.lot_fits(study, lot)  # says what is missing before anything is condensed
    condensed = up_to_date(study, ["springs", "reduce"], options)
    shared = hysteresis.prepare(Job(study, 1, settings.RUNS, condensed.outputs, Cache(settings.RUNS / ".cache", "")))
    solve = partial(loaded_units, shared)
    findings = [results.lot_findings(study, lot, solve, options.units, condensed.jobs) for lot in lots]
    folder = settings.RUNS / "lots" / "-".join([study.name, *(lot.name for lot in lots)])
    results.write_tables(study, findings, folder)
    files = []
    for found in findings:
        name = f"{study.name}-{found.lot.name}"
        text = results.study_text(study, found.fits, found.lot.name, name, DESIGN_FILE)
        write_atomic(folder / f"{name}.toml", text.encode())
        files.append(f"{name}.toml")
    write_atomic(folder / DESIGN_FILE, toml_of(study.design.model_dump()).encode())
    write_lots_page(study, findings, files, folder)
    for found in findings:
        print("\n".join(sentences(found, study)))
    print(f"report: {settings.shown(folder / 'report.html')}")


def read_lot(path: Path, study: Study) -> MeasuredLot:
    """The parts of a CSV file."""
    try:
        check_text(path, path.name)
        frame = pd.read_csv(path, dtype=str, keep_default_na=False, encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        raise InputError(f"{path.name}: no table: {error}; give a CSV file with one row per part") from None
    columns = dict(zip(header(frame.columns, path.name), (frame[name].tolist() for name in frame), strict=True))
    return measured_lot(path.stem, columns, study.design)
