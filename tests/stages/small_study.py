"""The small study of the tests of the stages, and how it is run."""

from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from pipeline.config import Study, load_study
from pipeline.engine.runner import Resources, run
from pipeline.engine.store import Output
from pipeline.figures import style
from stages.chain import STAGES

PRINT = style.save
"""Two thirds of the time of a small study's page."""

ROOT = Path(__file__).parent.parent.parent
LAST = "aggregate"


def small_study(**samples: object) -> Study:
    """The quick study with few samples and rigid angles, and all contacts kept; ``samples`` change its samples."""
    study = load_study("quick", ROOT)
    return study.model_copy(
        update={
            "samples": study.samples.model_copy(update={"count": 8, **samples}),
            "cycle": study.cycle.model_copy(update={"keep_contacts": "all", "rigid_angles": 31}),
            "model_forms": None,
        }
    )


def run_study(study: Study, runs: Path, jobs: int = 1, chunk: int = 100) -> dict[str, Output]:
    return run(STAGES, study, [LAST, "tails"], runs, Resources(jobs, chunk))


def save_named(*names: str) -> Callable[[Figure, Path], None]:
    """In place of ``figures.style.save``: figures of these names are printed, all others are made and left empty."""

    def save(figure: Figure, stem: Path) -> None:
        if stem.name in names:
            PRINT(figure, stem)
        else:
            for ending in (".svg", ".png"):
                stem.with_suffix(ending).write_text("<svg/>")

    return save
