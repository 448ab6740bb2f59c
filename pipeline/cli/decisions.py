"""Commands that help to decide: two runs side by side."""

import argparse

import pandas as pd

from pipeline.cli import settings
from pipeline.config import Study, load_study
from pipeline.decisions.run_comparison import Run, differences, differing_inputs, driver_changes
from pipeline.engine.runner import run
from pipeline.report.decisions.compare import sentence, write_comparison
from stages.aggregate import over_turn
from stages.chain import STAGES


def compare_runs(options: argparse.Namespace) -> None:
    """Hold run B against run A."""
    a, b = (_run(load_study(name, settings.ROOT), options) for name in (options.a, options.b))
    rows = differences(a, b)
    folder = settings.RUNS / "compare" / f"{a.label}-{b.label}"
    write_comparison(a, b, differing_inputs(a.study, b.study), rows, driver_changes(a, b), folder)
    print(sentence(a, b, pd.DataFrame(rows)))
    print(f"report: {settings.shown(folder / 'report.html')}")


def _run(study: Study, options: argparse.Namespace) -> Run:
    with settings.resources(study, options) as resources:
        outputs = run(STAGES, study, ["aggregate"], settings.RUNS, resources)
    units, sensitivity = (pd.DataFrame(outputs["aggregate"].read(name)) for name in ("units", "sensitivity"))
    return Run(study, over_turn(units, study.limits.over), sensitivity)
