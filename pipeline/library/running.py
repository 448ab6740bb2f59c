"""Bringing a study up to date: with the samples that it states, or with as many as its yield takes.

A study that asks for samples `until` its yield is known runs in batches. What a batch has answered is remembered under
the settings and sources that it rests on, so that a killed study goes on where it was and a finished one asks nothing.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Generic, TypeVar

import pandas as pd

from pipeline import settings
from pipeline.config import Study, load_study
from pipeline.config.studies.study import Drivers
from pipeline.engine import progress, runner
from pipeline.engine.cache import Cache
from pipeline.engine.cluster import dask_cluster
from pipeline.engine.fingerprint import code_of, package_versions, source_hashes
from pipeline.engine.parallel import end_with_parent
from pipeline.engine.runner import Resources
from pipeline.engine.stage import Job
from pipeline.engine.store import Output, write_json
from pipeline.errors import InputError
from pipeline.model.equilibrium.solve import compile_solver, solver_is_compiled
from pipeline.report.results import yield_estimate
from pipeline.statistics.intervals import Estimate, next_units
from stages import hysteresis
from stages.aggregate import AGGREGATE
from stages.chain import STAGES
from stages.hysteresis import HYSTERESIS

UNKNOWN_YIELD = Estimate(0.5, 0.0, 1.0, 0)
"""The yield where no unit has a result."""
ANSWER = "yield.json"
"""In the cache: the yield of a batch with its interval."""

COMPILES_SOLVER = (
    f"import sys; from {end_with_parent.__module__} import end_with_parent; end_with_parent(int(sys.argv[1])); "
    f"from {compile_solver.__module__} import compile_solver; compile_solver()"
)


@dataclass(frozen=True)
class Workers:
    """Who solves: ``jobs`` processes of this machine (the study's own number if None), or those of a Dask cluster.

    Attributes
    ----------
    backend : "loky", or "dask" with the address of its ``scheduler``.
    open_scheduler : whether one may be used that does not authenticate its peers.
    """

    jobs: int | None = None
    backend: str = "loky"
    scheduler: str | None = None
    open_scheduler: bool = False

    @contextmanager
    def resources(self, study: Study) -> Iterator[Resources]:
        """Where and with how many processes chunks are solved; a cluster is connected while the context lasts.

        Raises
        ------
        InputError : of numbers and names that do not go together.
        """
        if self.jobs is not None and self.jobs < 1:
            raise InputError(f"--jobs = {self.jobs}; must be at least 1")
        if (self.backend == "dask") != (self.scheduler is not None):
            raise InputError("--backend dask and --scheduler ADDRESS go together; give both or neither")
        if self.scheduler is not None:
            with dask_cluster(self.scheduler, self.open_scheduler) as cluster:
                yield Resources(self.jobs or ALL_WORKERS, study.run.chunk, cluster)
        else:
            yield Resources(self.jobs or study.run.jobs, study.run.chunk)


ALL_WORKERS = -1
"""Joblib's number of processes for as many as the cluster has."""


@dataclass(frozen=True)
class Finished:
    """A study with the samples that it came to, the outputs of its stages, and the processes that it may use."""

    study: Study
    outputs: dict[str, Output]
    jobs: int


def study_of(study: Study | str | Path) -> Study:
    """A study, or that of a TOML file, or of its stem in data/studies; raises InputError as ``load_study``."""
    return study if isinstance(study, Study) else load_study(study, settings.ROOT)


def workers_of(jobs: int | Workers | None) -> Workers:
    """Processes by their number."""
    return jobs if isinstance(jobs, Workers) else Workers(jobs)


def up_to_date(study: Study, targets: Sequence[str], jobs: int | Workers | None = None) -> Finished:
    """Bring stages of a study up to date; if one of them draws samples, their number is settled before.

    Raises
    ------
    InputError
        If a setting is wrong, or another process writes the run.
    """
    needed = runner.needed_stages(STAGES, targets)
    ahead = solver_compiled_ahead() if HYSTERESIS in needed else nullcontext()
    with workers_of(jobs).resources(study) as resources, ahead:
        if any("samples" in stage.sections for stage in needed):
            study = _study_with_samples(study, resources)
        outputs = runner.run(STAGES, study, targets, settings.RUNS, resources)
        return Finished(study, outputs, resources.jobs)


def prepared_loops(study: Study, outputs: dict[str, Output]) -> hysteresis.Shared:
    """What the loops of further units of a study share, from its stages ``springs`` and ``reduce``."""
    return hysteresis.prepare(Job(study, 1, settings.RUNS, outputs, Cache(settings.RUNS / ".cache", "")))


@contextmanager
def solver_compiled_ahead() -> Iterator[None]:
    """Within it another process compiles the solver, unless a run before has, while this one runs the stages before it.

    Whoever needs the solver waits for it, see ``pipeline.model.compiled``; the process ends with the context.
    """
    if solver_is_compiled():
        yield
        return
    quiet = subprocess.DEVNULL
    command = [sys.executable, "-c", COMPILES_SOLVER, str(os.getpid())]
    with subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet) as process:
        try:
            yield
        finally:
            process.terminate()


def known_size(study: Study) -> Study:
    """The study with the samples that the batches so far have come to; nothing is run."""
    return _study_with_samples(study, None)


def _study_with_samples(study: Study, resources: Resources | None) -> Study:
    """The study with the samples that its yield takes; without resources, as far as former batches tell."""
    stop_rule = study.samples.until
    if stop_rule is None:
        return study
    batch = count = study.samples.count
    while True:
        study = study.with_section("samples", count=count)
        answer = _answer(study, resources)
        if (
            answer is None
            or count >= stop_rule.at_most
            or answer.ci_high - answer.ci_low <= 2 * stop_rule.yield_half_width
        ):
            return study
        needed_units = next_units(answer.value, answer.n, count, stop_rule.yield_half_width, study.metrics.confidence)
        count = min(-(-needed_units // batch) * batch, stop_rule.at_most)


class _NotYet(Exception):
    """A batch has not been run."""


def _answer(study: Study, resources: Resources | None) -> Estimate | None:
    """Yield of a batch, run if nothing remembers it; None if it must not be run."""

    def run(folder: Path) -> None:
        if resources is None:
            raise _NotYet
        write_json(folder / ANSWER, asdict(_yield(study, resources)))

    code = code_of(source_hashes(AGGREGATE.module), package_versions())
    left_out = dict.fromkeys(("name", "title", "description", "run", "costs", "drivers"), True)
    values = study.model_dump(mode="json", exclude={**left_out, "samples": {"until"}})
    try:
        folder = Cache(settings.RUNS / ".cache", code).folder(f"yield of {json.dumps(values, sort_keys=True)}", run)
    except _NotYet:
        return None
    return Estimate(**json.loads((folder / ANSWER).read_text()))


def _yield(study: Study, resources: Resources) -> Estimate:
    """Yield against all limits of a study with the samples that it states, without shares of the variance."""
    reduced_study = study.model_copy(update={"drivers": Drivers()})
    outputs = runner.run(STAGES, reduced_study, [AGGREGATE.name], settings.RUNS, resources)
    distributions = pd.DataFrame(outputs[AGGREGATE.name].read("distributions"))
    answer = yield_estimate(distributions, study.limits.over) or UNKNOWN_YIELD
    width = (answer.ci_high - answer.ci_low) / 2
    progress.say("samples", f"{study.samples.count}: yield {answer.value:.4f} +-{width:.4f}")
    return answer


Result = TypeVar("Result")


@dataclass(frozen=True)
class Answer(Generic[Result]):
    """What was found, in objects, tables and sentences, and the folder that it was written into.

    Attributes
    ----------
    result : the objects that the tables are made of.
    sentences : what the command prints.
    folder : of the files.
    tables : frames by name, the main one first.
    page : file name of the page, "" where there is none.
    """

    result: Result
    sentences: tuple[str, ...]
    folder: Path
    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    page: str = "report.html"

    def __str__(self) -> str:
        return "\n".join(self.sentences)

    def table(self, name: str) -> pd.DataFrame:
        """A table by its name; KeyError if there is none, with the names that there are."""
        if name not in self.tables:
            raise KeyError(f"no table {name!r}; there are {', '.join(self.tables) or 'none'}")
        return self.tables[name]

    def to_frame(self) -> pd.DataFrame:
        """The main table; empty where the data allowed none."""
        return next(iter(self.tables.values()), pd.DataFrame())

    @property
    def report(self) -> Path | None:
        """The page."""
        return self.folder / self.page if self.page else None
