"""The tables of a study with a meshed disk are equal to the bit, whatever the threads, workers and chunks."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
from test_killed_commands import ROOT, finished

STUDY = (ROOT / "data/studies/quick.toml").read_text().partition("[model_forms]")[0]
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
WAYS = {
    "reference": (1, 64, {}),
    "two workers, chunks of 3": (2, 3, {}),
    "four workers, chunks of 5": (4, 5, {}),
    "one thread": (1, 64, dict.fromkeys(THREADS, "1")),
    "four threads, two workers": (2, 64, dict.fromkeys(THREADS, "4")),
}
"""Workers, samples a chunk, and variables of the environment."""


@pytest.mark.attack
def test_tables_are_equal_to_the_bit(tmp_path: Path) -> None:
    contents = {}
    for number, (way, (jobs, chunk, variables)) in enumerate(WAYS.items()):
        home = tmp_path / f"home{number}"
        shutil.copytree(ROOT / "data/designs", home / "data/designs")
        for name in ("studies", "measured"):
            (home / "data" / name).mkdir()
        text = STUDY.replace("count = 50", "count = 12").replace("[0.0, 90.0]", "[0.0]\nrigid_angles = 3")
        text += f"[drivers]\nbase_samples = 32\n[tails]\nunits = 1000\nsolve = 100\n[run]\nchunk = {chunk}\n"
        (home / "data/studies/killed.toml").write_text(text)
        content, seconds = finished(home, home / "here/runs", "run", jobs, **variables)
        print(f"{way}: {len(content)} results, {seconds:.0f} s", flush=True)
        contents[way] = {name: re.sub(r"part-\d+", "part", hashes) for name, hashes in content.items()}
    assert [way for way, content in contents.items() if content != contents["reference"]] == []
