"""A million samples to the page: memory below 2 GiB, a page below 10 MB, time that grows with the number alone."""

from pathlib import Path

import pytest

from pipeline.config import Study, load_study
from pipeline.engine.runner import Resources, run
from pipeline.engine.store import Output
from stages.chain import STAGES

ROOT = Path(__file__).parents[2]
GIB = 2**30


def study_of(count: int) -> Study:
    """The quick study at one crank angle."""
    study = load_study("quick", ROOT)
    return study.model_copy(
        update={
            "name": f"samples_{count}",
            "samples": study.samples.model_copy(update={"count": count}),
            "cycle": study.cycle.model_copy(update={"crank_deg": (0.0,), "rigid_angles": 1}),
        }
    )


def seconds(outputs: dict[str, Output]) -> float:
    return sum(output.record["seconds"] for output in outputs.values())


@pytest.mark.attack
def test_time_and_memory_of_a_million_samples(tmp_path: Path) -> None:
    timings = []
    for count in (100_000, 1_000_000):
        outputs = run(STAGES, study_of(count), ["report"], tmp_path, Resources(2, 512))
        timings.append(seconds(outputs))
        page = outputs["report"].path("report.html")
        written = sum(file.stat().st_size for file in tmp_path.rglob("*") if file.is_file())
        peak = max(output.record["peak_memory_bytes"] for output in outputs.values())
        print(f"{count:,} samples: {timings[-1]:.0f} s, peak of all processes {peak / GIB:.2f} GiB")
        print(f"{written:,} bytes, of which the page has {page.stat().st_size:,}")
        for name, output in outputs.items():
            print(f"{name}: {output.record['seconds']:.0f} s, {output.record['peak_memory_bytes'] / GIB:.2f} GiB")
        assert peak < 2 * GIB
        assert page.stat().st_size < 10_000_000
        assert outputs["hysteresis"].record["failed"] == 0
    assert timings[1] < 13 * timings[0]
