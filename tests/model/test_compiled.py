"""The compiler's cache between processes."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
SCRIPT = """
import numpy as np
from pipeline.model.load_history import rayleigh
twist = rayleigh.rayleigh_twist(np.array([0.0, 1.0, 0.5]), 2.0)
print(twist.tolist(), sum(rayleigh._followed.stats.cache_misses.values()))
"""


def test_processes_that_start_at_once_compile_a_loop_once(tmp_path: Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(ROOT)}
    started = [
        subprocess.Popen([sys.executable, "-c", SCRIPT], env=environment, stdout=subprocess.PIPE, text=True)
        for _ in range(3)
    ]
    printed = [process.communicate()[0].rsplit(maxsplit=1) for process in started]
    assert [twist for twist, _ in printed] == ["[0.0, 2.0, 1.75]"] * 3
    assert sorted(int(misses) for _, misses in printed) == [0, 0, 1]
