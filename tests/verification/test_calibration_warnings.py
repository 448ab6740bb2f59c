"""A calibration says where it ends at a bound, and writes no design where it misses its targets."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.checks import calibrate
from pipeline.checks.calibrate import Calibration, FittedNumber, read_targets, write
from pipeline.checks.response import Fitted
from pipeline.config import load_study
from pipeline.errors import InputError

ROOT = Path(__file__).parent.parent.parent
NUMBER = FittedNumber("output.roller_length_mm", 5.0, 20.0)


def calibration(value: float, residual: tuple[float, ...]) -> Calibration:
    one = np.array([value])
    fit = Fitted(one, 0.9 * one, 1.1 * one, np.array(residual), np.eye(1), np.ones(1))
    return Calibration(load_study("paper_tables", ROOT), None, (NUMBER,), fit, np.ones(len(residual), bool))


def test_numbers_at_a_bound_and_targets_that_are_missed_are_said() -> None:
    assert not calibration(12.0, (0.01, -0.02)).warnings
    (at_bound,) = calibration(20.0, (0.01, -0.02)).warnings
    assert "output.roller_length_mm = 20 is at its upper bound" in at_bound
    missing = calibration(12.0, (0.01, -0.97))
    assert "misses targets by up to 97 %, so no design is written" in missing.warnings[0]
    assert "no intervals: 1 targets for 1 numbers" in calibration(12.0, (0.0,)).warnings[0]


def test_no_design_is_left_where_targets_are_missed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(calibrate, "target_values", lambda *_: np.empty(0))
    (tmp_path / "design.toml").write_text("of an earlier fit")
    write(replace(calibration(12.0, (-0.97,)), used=np.empty(0, bool)), (), "targets.csv", tmp_path)
    assert not (tmp_path / "design.toml").exists()


def test_a_negative_target_is_refused(tmp_path: Path) -> None:
    text = (ROOT / "data/published/pham2017_table2.csv").read_text()
    head, row, *rest = text.splitlines()
    cells = row.split(",")
    cells[head.split(",").index("value")] = "-1.5"
    (tmp_path / "targets.csv").write_text("\n".join([head, ",".join(cells), *rest]))
    with pytest.raises(InputError, match="must be >= 0"):
        read_targets(tmp_path / "targets.csv", load_study("paper_tables", ROOT))
