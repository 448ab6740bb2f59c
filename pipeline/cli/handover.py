"""Commands for the people downstream: a study's population as joints of simulators, and where a run comes from."""

import argparse
from pathlib import Path

import pandas as pd

from pipeline import settings
from pipeline.cli.arguments import workers
from pipeline.config import load_study
from pipeline.decisions.joint import FORMATS, JOINTS, joints
from pipeline.engine.provenance import FILE, crate
from pipeline.engine.store import write_atomic, write_json
from pipeline.engine.table import columns_of_frame
from pipeline.errors import InputError
from pipeline.library.running import up_to_date
from pipeline.report.workbook import write_workbook


def write_joints(options: argparse.Namespace) -> None:
    """Write backlash, stiffness and friction of a study's quantiles for simulators."""
    study = load_study(options.study, settings.ROOT)
    outputs = up_to_date(study, ["aggregate"], workers(options)).outputs
    joint_rows = joints(pd.DataFrame(outputs["aggregate"].read("units")).iloc[int(study.samples.nominal_first) :])
    folder = settings.RUNS / "joints" / study.name
    rows = pd.DataFrame([vars(joint) for joint in joint_rows])
    write_atomic(folder / "joints.parquet", JOINTS.part(columns_of_frame(rows)).data)
    write_atomic(folder / "joints.csv", rows.to_csv(index=False, float_format="%.9g").encode())
    for joint in joint_rows:
        for ending, text in FORMATS.items():
            write_atomic(folder / f"{joint.quantile}.{ending}", text(joint).encode())
    print(rows.to_string(index=False, float_format=lambda value: f"{value:.5g}"))
    print(f"files: {settings.shown(folder)}")


def write_provenance(options: argparse.Namespace) -> None:
    """Write what a run was made from, beside its stages."""
    folder = Path(options.run) if Path(options.run).is_dir() else settings.RUNS / options.run
    write_json(folder / FILE, crate(folder))
    print(f"RO-Crate: {settings.shown(folder / FILE)}")


def write_spreadsheet(options: argparse.Namespace) -> None:
    """Write the tables of a folder of results as a workbook."""
    folder = Path(options.folder) if Path(options.folder).is_dir() else settings.RUNS / options.folder
    if not folder.is_dir():
        raise InputError(f"{options.folder}: no folder of results; run a study or a command first")
    file = options.out or folder / f"{folder.name}.xlsx"
    written_tables, left_out = write_workbook(folder, file)
    print(f"{settings.shown(file)}: {', '.join(written_tables)}")
    for sentence in left_out:
        print(f"left out: {sentence}")
