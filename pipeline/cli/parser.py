"""What can be typed: commands and their options. Nothing heavy is imported before a command is known."""

import argparse
import contextlib
import math
from pathlib import Path
from typing import NoReturn, Protocol

from pipeline.errors import shortened


class Parser(argparse.ArgumentParser):
    """A parser whose messages echo no more of a value than can be read."""

    def error(self, message: str) -> NoReturn:
        super().error(shortened(message))


class Commands(Protocol):
    """Adds a command: its name, its action as "module.function" of this package, its help text."""

    def __call__(self, name: str, action: str, text: str) -> argparse.ArgumentParser: ...


def parser() -> argparse.ArgumentParser:
    """All commands; `command` of the parsed options is the action, `name_of_command` what was typed."""
    program = Parser(prog="python -m pipeline", description="Tolerance studies of cycloid reducers.")
    commands = program.add_subparsers(required=True, metavar="COMMAND")

    def command(name: str, action: str, text: str) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=text, description=text)
        sub.set_defaults(command=action, name_of_command=name, opening="")
        return sub

    _studies(command)
    _decisions(command)
    _parts(command)
    _handover(command)
    _add_measured_unit(command)
    _checks(command)
    return program


def _studies(command: Commands) -> None:
    running = command("run", "studies.run_stages", "run stages, and whatever they depend on that is missing or stale")
    running.add_argument("stage", nargs="*", help="stages wanted; default: the last one, the report")
    running.add_argument("--dry-run", action="store_true", help="say what would run, why, and about how long")
    _study(running)
    _where(running)

    asking = command("why", "studies.reasons", "say which input, setting or source makes a stage stale")
    asking.add_argument("stage")
    _study(asking)

    single = command("unit", "studies.solve_unit", "solve one reducer with as-measured dimensions")
    single.add_argument("design", help="design file, or the stem of one in data/designs")
    single.add_argument("--dimensions", required=True, type=Path, help="TOML file of measured errors in micrometres")
    _study(single)
    _where(single)

    resolving = command("resolve", "studies.resolve_contacts", "write the contact forces of any sample of a run")
    resolving.add_argument("study", help="study file, or the stem of one in data/studies")
    resolving.add_argument("--sample", required=True, type=int)
    _where(resolving)

    turning = command("turn", "turn.turn_unit", "transmission error of a sample over an output turn, and its orders")
    turning.add_argument("study", help="study file, or the stem of one in data/studies")
    turning.add_argument("--sample", required=True, type=int)

    sparing = command("tails", "studies.find_tails", "units beyond the limits in parts per million, and far quantiles")
    _study(sparing)
    _where(sparing)
    sparing.add_argument("--units", type=int, help="evaluated by the surrogate; default: the study's, or 100,000")
    sparing.add_argument("--solve", type=int, help="of them load-solved on average; default: the study's, or 4,000")

    drawing = command("flank", "handover.write_flank", "write the flank of a design as CSV and DXF, drawn and measured")
    drawing.add_argument("--design", required=True, help="design file, or the stem of one in data/designs")
    drawing.add_argument("--out", required=True, type=Path, help="folder for drawn.csv, measured.csv and flank.dxf")
    drawing.add_argument("--points", type=int, default=360, help="of each lobe; default: 360")

    checking = command(
        "check", "studies.check_run", "compare every byte of a run with its records, and say what to run again"
    )
    checking.add_argument("run", help="folder of a run, or the name of one in data/runs")

    showing = command("show", "studies.show_run", "print the summary of a run")
    showing.add_argument("run", help="folder of a run, or the name of one in data/runs")

    listing = command("keys", "keys.show_keys", "every key of design, study and unit files: type, unit, default, sign")
    listing.add_argument("name", nargs="?", help="design, study, unit, or the beginning of a key, as tolerances")

    making = command("new", "keys.write_new", "write a commented design, study or measured unit that runs")
    making.add_argument("kind", choices=("design", "study", "unit"))
    making.add_argument("name", help="of the file in data/designs or data/studies, or of the folder in data/measured")
    making.add_argument("--design", help="design of a study; default: pin_in_hole_39")

    command("clean-runs", "studies.clean_runs", "delete all runs, never inputs")


def _decisions(command: Commands) -> None:
    comparing = command("compare", "questions.compare_runs", "compare two studies: what differs, and by how much")
    comparing.add_argument("a", help="study file, or the stem of one in data/studies")
    comparing.add_argument("b", help="the other one; differences are b less a")
    _where(comparing)

    choosing = command(
        "allocate", "questions.allocate_tolerances", "the cheapest tolerances of a study at a wanted yield"
    )
    _study(choosing)
    choosing.add_argument(
        "--yield", dest="target", type=_finite, default=0.99, help="against all limits; default: 0.99"
    )
    choosing.add_argument("--units", type=int, default=4_000, help="load-solved in each round; default: 4,000")
    _where(choosing)

    counting = command(
        "reweigh", "questions.reweigh_run", "yield of a study with tighter tolerances from the run of a wider one"
    )
    counting.add_argument("wide", help="study file, or the stem of one in data/studies, whose run is reweighted")
    counting.add_argument("narrow", help="the study with the tighter tolerances")
    counting.add_argument("--check", type=int, default=1_000, help="fresh load-solved units; default: 1,000")
    _where(counting)

    bounding = command(
        "bounds", "questions.bound_metrics", "worst cases over the tolerance box, linear stacks, capability"
    )
    _study(bounding)
    _where(bounding)


def _parts(command: Commands) -> None:
    judging = command(
        "lots", "questions.judge_lots", "yield of a study made from measured parts, and what costs most of it"
    )
    judging.add_argument(
        "--csv", required=True, type=Path, action="append", help="measured parts; twice: two lots side by side"
    )
    judging.add_argument("--units", type=int, default=2_000, help="load-solved for each yield; default: 2,000")
    _study(judging)
    _where(judging)

    pairing = command("assemble", "questions.assemble_parts", "which measured parts of two lots to put together")
    pairing.add_argument("--csv", required=True, type=Path, action="append", help="measured parts; given twice")
    pairing.add_argument("--mounting-force", type=_finite, metavar="N", help="allowed contact force without torque")
    _study(pairing)
    _where(pairing)

    certifying = command("certificate", "questions.certify_unit", "what one unit will do, from its measured dimensions")
    certifying.add_argument(
        "--dimensions", required=True, type=Path, help="TOML file of measured errors in micrometres"
    )
    certifying.add_argument("--unit", help="folder with a unit.toml of a measured loop, as for identify")
    certifying.add_argument("--draws", type=int, default=200, help="of the other dimensions; default: 200")
    _study(certifying)
    _where(certifying)


def _handover(command: Commands) -> None:
    handing = command("joints", "handover.write_joints", "backlash, stiffness, friction of a study for simulators")
    _study(handing)
    _where(handing)

    exporting = command("workbook", "handover.write_spreadsheet", "tables of a page or a run as one .xlsx file")
    exporting.add_argument("folder", help="folder with tables, or its name in data/runs, as quick or allocate/paper")
    exporting.add_argument("--out", type=Path, help="file to write; default: in the folder")

    tracing = command(
        "provenance", "handover.write_provenance", "write a run's inputs, versions and hashes as an RO-Crate"
    )
    tracing.add_argument("run", help="folder of a run, or the name of one in data/runs")


def _add_measured_unit(command: Commands) -> None:
    naming = command(
        "identify", "identify.identify_unit", "say why a measured unit differs from its model, and correct the model"
    )
    subject = naming.add_mutually_exclusive_group(required=True)
    subject.add_argument("--unit", default="", help="folder with a unit.toml, or the name of one in data/measured")
    subject.add_argument("--series", default="", help="folder with a folder of each state of one drive")
    naming.add_argument("--over", default="", help="variable of [state] that orders a series; default: the first")
    naming.set_defaults(opening="reading {unit}{series}")
    _where(naming)

    changing = command("changed", "questions.compare_states", "say what changed between two measurements of one drive")
    for state in ("before", "after"):
        changing.add_argument(
            f"--{state}", required=True, help="folder with a unit.toml, or the name of one, as for identify"
        )
    changing.add_argument(
        "--also",
        nargs="*",
        default=[],
        help="further states of the drive, or folders of them: they give the scatter of mounting",
    )

    changing.set_defaults(opening="reading the units {before} and {after}")

    comparing = command("population", "questions.compare_population", "compare measured units with a study")
    comparing.add_argument("--units", required=True, type=Path, help="CSV file, one row per unit with its metrics")
    comparing.add_argument(
        "--over",
        choices=("mean", "worst"),
        default="mean",
        help="value of each sample over the study's crank angles, for units without crank_deg; default: mean",
    )
    comparing.add_argument(
        "--noise",
        type=_finite,
        metavar="PERCENT",
        help="repeatability of the bench, the standard deviation of a value in percent of it; "
        "fewer than five units, and single units, are tested with it alone",
    )
    _study(comparing)
    _where(comparing)


def _checks(command: Commands) -> None:
    _where(command("paper", "checks.compare_paper", "compare the paper's Table 2, contacts and figures with the model"))

    fitting = command(
        "calibrate", "checks.fit_design", "fit numbers of a study's design to published metrics of its cases"
    )
    fitting.add_argument("--study", help="study of cases, or its stem in data/studies; default: the paper's tables")
    fitting.add_argument("--targets", type=Path, help="CSV of published metrics; default: the paper's Table 2")
    fitting.add_argument("--parameters", type=Path, help="CSV of fitted numbers (key, lower, upper); default: three")

    verifying = command(
        "verify", "checks.verify_mechanics", "compare the mechanics with exact answers and independent solvers"
    )
    verifying.add_argument("--mesh", choices=("coarse", "paper"), default="paper", help="default: paper")
    verifying.add_argument("--study", help="in place of the paper's reducer: those checks that apply to this study")

    exporting = command("export-ccx", "checks.export_deck", "write a sample of a study as an input deck of CalculiX")
    exporting.add_argument("study", help="study file, or the stem of one in data/studies")
    exporting.add_argument("--sample", required=True, type=int)
    exporting.add_argument("--crank", type=_finite, metavar="DEG", help="crank angle; default: the study's first")


def _study(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--study", default="paper", help="study file, or the stem of one in data/studies")


def _where(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--jobs", type=int, help="processes; default: the study's")
    sub.add_argument("--backend", choices=("loky", "dask"), default="loky", help="this machine, or a Dask cluster")
    sub.add_argument("--scheduler", help="address of the cluster's scheduler, as in tls://192.0.2.1:8786")
    sub.add_argument(
        "--open-scheduler", action="store_true", help="allow an unauthenticated scheduler on a private network"
    )


def _finite(text: str) -> float:
    with contextlib.suppress(ValueError):
        if math.isfinite(value := float(text)):
            return value
    raise argparse.ArgumentTypeError(f"{text} is no finite number")
