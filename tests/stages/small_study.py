"""The small study of the tests of the stages, and how it is run."""

from pathlib import Path

from pipeline.config import Study, load_study
from pipeline.engine.runner import Resources, run
from pipeline.engine.store import Output
from stages.chain import STAGES

ROOT = Path(__file__).parent.parent.parent
LAST = "aggregate"


def small_study(**samples: object) -> Study:
    """The quick study with few samples and all contacts kept; ``samples`` change its samples."""
    study = load_study("quick", ROOT)
    return study.model_copy(
        update={
            "samples": study.samples.model_copy(update={"count": 8, **samples}),
            "cycle": study.cycle.model_copy(update={"keep_contacts": "all"}),
            "model_forms": None,
        }
    )


def run_study(study: Study, runs: Path, jobs: int = 1, chunk: int = 100) -> dict[str, Output]:
    return run(STAGES, study, [LAST, "tails"], runs, Resources(jobs, chunk))
