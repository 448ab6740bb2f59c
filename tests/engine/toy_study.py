"""A study of pure arithmetic, with each kind of stage that the engine knows: no mechanics.

Run as a script it runs the study, for tests that kill it: `toy_study.py RUNS JOBS CHUNK`.
"""

import json
import os
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
from joblib.externals.loky import process_executor

from pipeline.engine.runner import Resources, run
from pipeline.engine.stage import Chunk, Job, Stage, Tables
from pipeline.engine.table import Column, Table


@dataclass(frozen=True)
class Numbers:
    count: int = 40
    seed: int = 1
    slope: float = 2.0
    note: str = ""


@dataclass(frozen=True)
class Toy:
    name: str = "toy"
    numbers: Numbers = field(default_factory=Numbers)
    plan: dict[str, list[int]] = field(default_factory=lambda: {"powers": [1, 2]})


@dataclass(frozen=True)
class Trouble:
    """What goes wrong in the solves, as JSON in the environment: it must not be part of a fingerprint."""

    seconds: float = 0.0
    fail_at: int = -1
    die_at: int = -1
    exhaust_at: int = -1
    keeps_MB: int = 0
    log: str = os.devnull

    @classmethod
    def ordered(cls) -> "Trouble":
        return cls(**json.loads(os.environ.get("TOY_TROUBLE", "{}")))


SAMPLE = Column("sample", "int32", "1", "number of the sample")
POINTS = Table(
    "points",
    "sample, point",
    (
        SAMPLE,
        Column("point", "int32", "1", "number of the point"),
        Column("x_mm", "float64", "mm", "abscissa"),
        Column("side", "label", "", "side of zero"),
    ),
)
SUMS = Table(
    "sums",
    "sample",
    (SAMPLE, Column("sum_mm", "float64", "mm", "sum of the powers"), Column("large", "bool", "", "sum above one")),
)
KEPT = Table("kept", "sample 0 only", (SAMPLE, Column("side", "label", "", "side of zero")))
TOTAL = Table("total", "statistic", (Column("statistic", "label", "", "name"), Column("value", "float64", "mm", "it")))
POINTS_PER_SAMPLE = 3
KEPT_BY_WORKER: list[np.ndarray] = []


def draw(job: Job) -> Tables:
    n = job.study.numbers.count
    x = np.random.default_rng(job.study.numbers.seed).normal(size=n * POINTS_PER_SAMPLE)
    columns = {
        "sample": np.repeat(np.arange(n, dtype=np.int32), POINTS_PER_SAMPLE),
        "point": np.tile(np.arange(POINTS_PER_SAMPLE, dtype=np.int32), n),
        "x_mm": x,
        "side": pd.Categorical.from_codes((x > 0).astype(np.int8), ["minus", "plus"]),
    }
    return {"points": columns}


def count(job: Job) -> int:
    return job.study.numbers.count


def powers(job: Job) -> dict[str, object]:
    def make(folder: Path) -> None:
        np.save(folder / "powers.npy", np.array(job.study.plan["powers"], dtype=float))

    stored = np.load(job.memo(f"powers {job.study.plan['powers']}", make) / "powers.npy")
    job.path("powers.txt").write_text(str(stored))
    return {"powers": stored, "slope": job.study.numbers.slope, "trouble": Trouble.ordered()}


def add(shared: dict, chunk: Chunk) -> Tables:
    trouble = shared["trouble"]
    with open(trouble.log, "a") as log:
        log.write(f"{chunk.start}\n")
    time.sleep(trouble.seconds)
    if chunk.start <= trouble.fail_at < chunk.stop:
        raise ValueError(f"cannot add sample {trouble.fail_at}")
    if chunk.start <= trouble.die_at < chunk.stop:
        os._exit(1)
    if chunk.start <= trouble.exhaust_at < chunk.stop:
        np.ones(1 << 50)  # a real refusal of the system: a petabyte
    if trouble.keeps_MB and chunk.start > 0:
        process_executor._MEMORY_LEAK_CHECK_DELAY, process_executor._MAX_MEMORY_LEAK_SIZE = 0.0, trouble.keeps_MB << 19
        KEPT_BY_WORKER.append(np.ones(trouble.keeps_MB << 17))
        with open(f"{trouble.log}.workers", "a") as workers:
            workers.write(f"{os.getpid()}\n")
    shared["powers"] *= 1.0  # arrays are writable in every process
    points = chunk.tables["draw/points"]
    total = (points["x_mm"][:, None] ** shared["powers"]).sum(axis=1).reshape(-1, POINTS_PER_SAMPLE).sum(axis=1)
    sums = {"sample": np.arange(chunk.start, chunk.stop), "sum_mm": shared["slope"] * total, "large": total > 1}
    kept_rows = {"sample": [0], "side": points["side"][:1]} if chunk.start == 0 else KEPT.empty()
    return {"sums": sums, "kept": kept_rows}


def large(tables: Tables) -> int:
    return int(tables["sums"]["large"].sum())


def finish(job: Job) -> Tables:
    sums = job.read("add", "sums")["sum_mm"]
    text = job.input_path("add", "powers.txt").read_text()
    return {"total": {"statistic": ["mean", "characters"], "value": [sums.mean(), len(text)]}}


DRAW = Stage("draw", (), ("numbers.count", "numbers.seed", "numbers.note"), (POINTS,), "toy_study", run=draw)
ADD = Stage(
    name="add",
    reads=("draw",),
    sections=("numbers.count", "numbers.slope", "plan"),
    tables=(SUMS, KEPT),
    module="toy_study",
    unit="samples",
    items=count,
    prepare=powers,
    solve=add,
    chunk_reads=("draw/points",),
    failures=large,
)
FINISH = Stage("finish", ("add",), (), (TOTAL,), "toy_study", run=finish)
STAGES = (DRAW, ADD, FINISH)


def entry(runs: Path, number: int) -> str:
    """What a study of its own has found, by two workers."""
    return run(STAGES, Toy(name=f"toy{number}"), ["finish"], runs, Resources(2, 10))["finish"].hashes["total"]


if __name__ == "__main__":
    from toy_study import STAGES as IMPORTED  # workers find the bodies under the module's name, not under __main__

    run(IMPORTED, Toy(), ["finish"], Path(sys.argv[1]), Resources(jobs=int(sys.argv[2]), chunk=int(sys.argv[3])))
