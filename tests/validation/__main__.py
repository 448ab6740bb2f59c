"""`python -m tests.validation COMMAND`: what judges the product, told and refused as the product's own commands are."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from pipeline import settings
from pipeline.cli import exit_status
from pipeline.cli.parser import Parser
from pipeline.config import load_study
from pipeline.engine.store import write_atomic
from pipeline.errors import InputError
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit
from tests.validation import bench, coverage
from tests.validation.blind.command_line import through_command_line
from tests.validation.blind.rates import write_reports
from tests.validation.blind.run import FULL_RUN, SEED, blind
from tests.validation.licences import UNKNOWN, licences
from tests.validation.rig import TRAINED, predicted_states, relocked_position, series_name, states_of, write_unit

SEVERAL_DISKS = "two_disks"
"""Study whose number of disks the bench changes."""
COARSE = "quick"
"""Study whose mesh CalculiX takes minutes for, not hours."""


def parser() -> argparse.ArgumentParser:
    """All commands; `command` of the parsed options is the action."""
    program = Parser(prog="python -m tests.validation", description="What judges the product.")
    commands = program.add_subparsers(required=True, metavar="COMMAND")
    for name, action in COMMANDS.items():
        summary = (action.__doc__ or "").partition("\n")[0]
        sub = commands.add_parser(name, help=summary, description=summary)
        sub.set_defaults(command=action)
        if name in ("bench", "coverage"):
            sub.add_argument("--study", default="paper", help="study file, or the stem of one in data/studies")
        if name in ("blind", "coverage"):
            sub.add_argument("--jobs", type=int, default=2, help="processes; default: 2")
        if name == "coverage":
            sub.add_argument("--repeats", type=int, default=2000, help="experiments per design; default: 2000")
        if name == "blind":
            sub.add_argument("--cases", type=int, default=FULL_RUN, help="default: the full run")
            sub.add_argument("--third", type=int, help="units of the third simulator; default: half of --cases")
            sub.add_argument("--first", type=int, default=0, help="number of the first case; default: 0")
            sub.add_argument("--seed", type=int, default=SEED, help="of the units")
        if name == "rig":
            sub.add_argument(
                "--data", required=True, type=Path, help="folder with a folder of position files for each state"
            )
    return program


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status, as `pipeline.cli.main` does."""
    return exit_status(lambda options: options.command(options), parser(), arguments)


def measure_speed(options: argparse.Namespace) -> None:
    """Measure the speed of a study's hot parts."""
    study = load_study(options.study, settings.ROOT)
    settings.RUNS.mkdir(parents=True, exist_ok=True)
    results = []
    coarse, several_disks = (load_study(name, settings.ROOT) for name in (COARSE, SEVERAL_DISKS))
    for result in bench.bench(study, coarse, several_disks, settings.RUNS):
        results.append(result)
        print(
            f"{result.name:34}{result.value:12.4g} {result.unit:4}{result.samples:7} samples  {result.note}", flush=True
        )
    bench.write(results, settings.RUNS / "bench")
    print(f"table: {settings.RUNS / 'bench' / 'bench.csv'}")


def run_blind(options: argparse.Namespace) -> None:
    """Test the identification on generated units."""
    _check_at_least(options, cases=0, first=0, jobs=1, seed=0)
    cases = range(options.first, options.first + options.cases)
    third = options.cases // 2 if options.third is None else options.third
    cases_of_third = range(options.first, options.first + third)
    rows = blind(cases, options.seed, options.jobs, settings.ROOT, settings.RUNS) if cases else []
    rows += through_command_line(cases_of_third, options.seed, options.jobs, settings.ROOT, settings.RUNS)
    folder = settings.RUNS / "blind"
    write_reports(rows, folder)
    print((folder / "rates.csv").read_text(encoding="utf-8"), end="")
    print(f"tables: {settings.shown(folder / 'cases.csv')}, compliant.csv")


def identify_rig(options: argparse.Namespace) -> None:
    """Predict every state of the printed drive's rig where nothing was fitted, beside the baselines."""
    home = settings.RUNS / "rig"
    measurements, again = {}, {}
    for state in states_of([options.data]):
        folder = write_unit(state, home / series_name(state.name) / state.name)
        measurements[state.name] = Measurement.read(load_measured_unit(folder, settings.ROOT))
        print("\n".join(measurements[state.name].summary), flush=True)
        relocked = relocked_position(state)
        if relocked:
            folder = write_unit(state, home / "again" / state.name, [TRAINED, relocked])
            again[state.name] = Measurement.read(load_measured_unit(folder, settings.ROOT))
    held_out = predicted_states(measurements, again).round(1)
    held_out.to_csv(home / "held_out.csv", index=False)
    print(held_out.to_string(index=False))
    print(f"table: {settings.shown(home / 'held_out.csv')}")


def count_coverage(options: argparse.Namespace) -> None:
    """Count how often intervals of a study's statistics hold the truth."""
    _check_at_least(options, repeats=1, jobs=1)
    study = load_study(options.study, settings.ROOT)
    truth = coverage.truths(coverage.reference(study, jobs=options.jobs))
    rows = []
    for experiment in coverage.EXPERIMENTS:
        for count in coverage.COUNTS:
            rows += coverage.coverages(study, experiment, count, options.repeats, truth, options.jobs)
    table = settings.RUNS / "coverage" / "coverage.csv"
    write_atomic(table, coverage.text(rows).encode())
    print(table.read_text(), end="")
    print(f"table: {settings.shown(table)}")


def list_licences(_: argparse.Namespace) -> None:
    """List the licence of every pinned package; raises SystemExit with status 1 where an installed one states none."""
    packages = licences(settings.ROOT / "constraints.txt")
    for package in packages:
        print(f"{package.package:24}{package.version:12}{package.licence}")
    unknown = [package.package for package in packages if package.licence == UNKNOWN and package.version != UNKNOWN]
    if unknown:
        print(f"without a licence: {', '.join(unknown)}", file=sys.stderr)
        raise SystemExit(1)


def _check_at_least(options: argparse.Namespace, **lowest: int) -> None:
    for name, limit in lowest.items():
        if getattr(options, name) < limit:
            raise InputError(f"--{name} = {getattr(options, name)}; must be at least {limit}")


COMMANDS = {
    "bench": measure_speed,
    "blind": run_blind,
    "rig": identify_rig,
    "coverage": count_coverage,
    "licences": list_licences,
}

if __name__ == "__main__":
    raise SystemExit(main())
