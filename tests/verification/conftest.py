"""The cases of the paper's Table 2 on a coarse mesh, through the stages once."""

from pathlib import Path

import pytest

from pipeline import assembly
from pipeline.checks.calibrate import read_parameters, read_targets
from pipeline.checks.paper import comparison
from pipeline.checks.response import Condensed
from pipeline.config import load_study
from pipeline.engine.runner import Resources, run
from stages.chain import STAGES
from stages.tables.condensed import COMPLIANCE_FILE, full_compliance

ROOT = Path(__file__).parents[2]
PUBLISHED = ROOT / "data" / "published"
COARSE = {"flank_edges_per_lobe": 32, "growth": 0.5, "largest_edge_mm": 2.5}


@pytest.fixture(scope="session")
def study():
    fine = load_study(comparison.STUDY, ROOT)
    cycle = fine.cycle.model_copy(update={"levels_per_branch": 8})
    return fine.model_copy(update={"reduce": fine.reduce.model_copy(update=COARSE), "cycle": cycle})


@pytest.fixture(scope="session")
def outputs(study, new_runs, run_once):
    runs = new_runs()
    return run_once("paper", runs / study.name, lambda: run(STAGES, study, ["aggregate"], runs, Resources(1, 250)))


@pytest.fixture(scope="session")
def disk(study, outputs):
    reducer = assembly.reducer(study.design, 0.0)
    return Condensed.from_compliance(
        full_compliance(outputs["reduce"].path(COMPLIANCE_FILE), reducer, 0.0), study.design
    )


@pytest.fixture(scope="session")
def targets(study):
    return read_targets(PUBLISHED / comparison.TARGETS, study)


@pytest.fixture(scope="session")
def parameters(study):
    return read_parameters(PUBLISHED / comparison.PARAMETERS, study.design)
