"""Commands on measured units: why one differs from its model, and whether many differ from a study."""

import argparse
from collections.abc import Sequence

import numpy as np

from pipeline import assembly
from pipeline.cli import settings
from pipeline.config import Study
from pipeline.engine.runner import run
from pipeline.errors import InputError
from pipeline.identification import results
from pipeline.identification.blind.report import write_reports
from pipeline.identification.blind.run import FULL_RUN, SEED, blind
from pipeline.identification.identify import identify
from pipeline.identification.unit import load_measured_unit
from pipeline.report.unit.page import write_page
from stages.chain import STAGES
from stages.condensed import COMPLIANCE_FILE, full_compliance


def add(command: settings.Commands) -> None:
    """Add the commands."""
    naming = command("identify", _identify, "say why a measured unit differs from its model, and correct the model")
    naming.add_argument("--unit", required=True, help="folder with a unit.toml, or the name of one in data/measured")
    settings.jobs_option(naming)

    testing = command("blind", _blind, "test the identification on generated units whose truth it cannot read")
    testing.add_argument("--cases", type=int, default=FULL_RUN, help=f"default: the full run of {FULL_RUN}")
    testing.add_argument("--seed", type=int, default=SEED, help="of the units")
    testing.add_argument("--jobs", type=int, default=2, help="processes; default: 2")


def _identify(options: argparse.Namespace) -> None:
    unit = load_measured_unit(options.unit, settings.ROOT)

    def condensed(study: Study, cranks: Sequence[float]) -> list[np.ndarray]:
        at_cranks = study.model_copy(
            update={"cycle": study.cycle.model_copy(update={"crank_deg": tuple(float(crank) for crank in cranks)})}
        )
        with settings.resources(study, options) as resources:
            outputs = run(STAGES, at_cranks, ["reduce"], settings.RUNS, resources)
        path = outputs["reduce"].path(COMPLIANCE_FILE)
        return [full_compliance(path, assembly.reducer(study.design, crank), crank) for crank in cranks]

    found = identify(unit, condensed)
    folder = settings.RUNS / "identify" / unit.name
    of = results.findings(found)
    results.write(of, folder)
    write_page(of, folder, settings.shown(folder))
    print(f"{found.verdict.verdict}: {found.verdict.sentence}")
    if found.verdict.advice:
        print(found.verdict.advice)
    print(f"report: {settings.shown(folder / 'report.html')}")


def _blind(options: argparse.Namespace) -> None:
    for name, least in (("cases", 1), ("jobs", 1), ("seed", 0)):
        if getattr(options, name) < least:
            raise InputError(f"--{name} = {getattr(options, name)}; must be at least {least}")
    rows = blind(options.cases, options.seed, options.jobs, settings.ROOT, settings.RUNS)
    folder = settings.RUNS / "blind"
    write_reports(rows, folder)
    print((folder / "rates.csv").read_text(encoding="utf-8"), end="")
    print(f"table: {settings.shown(folder / 'cases.csv')}")
