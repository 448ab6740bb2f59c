"""The command of one unit over a turn of the output: transmission error without and under load, and its orders."""

import argparse
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import settings
from pipeline.cli.arguments import check_sample
from pipeline.config import Study, load_study
from pipeline.engine.cache import Cache
from pipeline.engine.progress import Line
from pipeline.engine.stage import Job
from pipeline.engine.store import write_atomic
from pipeline.engine.table import Column, Table, columns_of_frame
from pipeline.errors import InputError
from pipeline.figures.hysteresis import output_turn_figure
from pipeline.figures.style import save
from pipeline.library.running import known_size
from pipeline.model.turn import orders
from pipeline.populations.output_turn import PHASES, OutputTurn, free_error, loaded_error, loaded_steps, rigid_cranks
from pipeline.sampling.errors import Errors, draw
from stages.reduce import DiskMatrices
from stages.tables.keys import CRANK
from stages.tables.over_turn import SENSE, SENSES, TORQUE
from stages.worst import drives_of

MOST_ROWS = 6
"""Strongest orders that are printed."""
ERROR = Table(
    "error",
    "sense, torque, crank of the output turn",
    (
        SENSE,
        TORQUE,
        CRANK,
        Column("error_arcsec", "float64", "arcsec", "angle of the output less the nominal ratio's"),
        Column("bearing_force_N", "float64", "N", "force of the first disk on its first bearing; null without torque"),
        Column("pin_force_N", "float64", "N", "contact force of pin 0; null without torque"),
    ),
)
ORDERS = Table(
    "orders",
    "sense, torque, order",
    (
        SENSE,
        TORQUE,
        Column("order_of_output", "int32", "1", "waves per turn of the output"),
        Column("order_of_crank", "float64", "1", "waves per turn of the crank"),
        Column("amplitude_arcsec", "float64", "arcsec", "amplitude a of a cos(order crank + phase)"),
        Column("phase_deg", "float64", "deg", "phase, likewise"),
    ),
)


def turn_unit(options: argparse.Namespace) -> None:
    """Write the transmission error of one sample over a turn of the output, and its orders."""
    study = known_size(load_study(options.study, settings.ROOT))
    check_sample(study, options.sample)
    unit = draw(study, options.sample, options.sample + 1)
    held_torque = study.metrics.rigidity_percent[1] / 100 * study.design.cycloid.rated_torque_Nm
    curves: dict[float, OutputTurn] = {}
    reasons: list[str] = []
    for torque, error_of in ((0.0, _free_error), (held_torque, _loaded_error)):
        try:
            curves[torque] = error_of(study, unit)
        except ArithmeticError as error:
            reasons.append(f"{torque:g} N m: {error}")
    if not curves:
        raise InputError([f"sample {options.sample} of study {study.name}: {reason}" for reason in reasons])
    folder = settings.RUNS / study.name / "output_turn"
    folder.mkdir(parents=True, exist_ok=True)
    errors, waves = _error_rows(curves), _order_rows(study, curves)
    for table, rows in ((ERROR, errors), (ORDERS, waves)):
        write_atomic(folder / f"{table.name}-{options.sample}.parquet", table.part(columns_of_frame(rows)).data)
    titles = {_what(torque): torque for torque in curves}
    of_errors, of_waves = (
        {title: rows[rows["torque_Nm"].abs() == torque] for title, torque in titles.items()} for rows in (errors, waves)
    )
    figure = output_turn_figure(of_errors, of_waves, study.design.cycloid.lobes, study.design.output.words.bearing)
    save(figure, folder / f"turn-{options.sample}")
    _say(study, curves)
    print(*(f"not known at {reason}" for reason in reasons), sep="\n", end="\n" if reasons else "")
    print(f"tables and figure turn-{options.sample}: {settings.shown(folder)}")


def _free_error(study: Study, unit: Errors) -> OutputTurn:
    with Line("without load", "crank angles", len(rigid_cranks(study))) as line:
        return free_error(study, unit, line.advance)


def _loaded_error(study: Study, unit: Errors) -> OutputTurn:
    with tempfile.TemporaryDirectory() as folder:
        disks = DiskMatrices(Job(study, 1, Path(folder), {}, Cache(Path(folder), "")))
        drives = drives_of(study, disks, PHASES)
        with Line("under load", "crank angles", len(loaded_steps(study, drives.phases))) as line:
            return loaded_error(drives, unit, line.advance)


def _error_rows(curves: dict[float, OutputTurn]) -> pd.DataFrame:
    return pd.concat(
        pd.DataFrame(
            {
                "sense": pd.Categorical([SENSES[k]] * len(turn.crank), categories=list(SENSES)),
                "torque_Nm": torque * (1 - 2 * k),
                "crank_deg": np.degrees(turn.crank),
                "error_arcsec": turn.error[k],
                "bearing_force_N": turn.bearing_force[k],
                "pin_force_N": turn.pin_force[k],
            }
        )
        for torque, turn in curves.items()
        for k in range(2)
    )


def _order_rows(study: Study, curves: dict[float, OutputTurn]) -> pd.DataFrame:
    lobes, parts = study.design.cycloid.lobes, []
    for torque, turn in curves.items():
        harmonics = orders(turn.error, turns=lobes)
        for k in range(2):
            parts.append(
                pd.DataFrame(
                    {
                        "sense": pd.Categorical([SENSES[k]] * len(harmonics.order), categories=list(SENSES)),
                        "torque_Nm": torque * (1 - 2 * k),
                        "order_of_output": np.arange(1, len(harmonics.order) + 1),
                        "order_of_crank": harmonics.order,
                        "amplitude_arcsec": harmonics.amplitude[k],
                        "phase_deg": np.degrees(harmonics.phase[k]),
                    }
                )
            )
    return pd.concat(parts)


def _what(torque: float) -> str:
    return f"{torque:g} N m held" if torque else "without load, at the ends of the play"


def _say(study: Study, curves: dict[float, OutputTurn]) -> None:
    for torque, turn in curves.items():
        spans = " and ".join(f"{span:.3g}" for span in np.ptp(turn.error, axis=1))
        print(
            f"transmission error over a turn of the output, {_what(torque)}: {spans} arcsec peak to peak in the senses "
            f"+ and -, from {len(turn.crank):,} crank angles"
        )
        harmonics = orders(turn.error, turns=study.design.cycloid.lobes)
        strongest = np.argsort(-harmonics.amplitude[0], kind="stable")[:MOST_ROWS]
        waves = (f"{k + 1} ({harmonics.order[k]:.4g}): {harmonics.amplitude[0, k]:.3g} arcsec" for k in strongest)
        print(f"  strongest waves per turn of the output (of the crank), sense +: {', '.join(waves)}")
