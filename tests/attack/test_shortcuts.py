"""Shortcuts of the search change its time and no verdict: drawn units with all of them off."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.identification.fitting import fitter
from pipeline.identification.identify import identify
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.identification.selection import model_selection, pairs, screening
from tests.validation.blind.catalogue import no_compliance
from tests.validation.blind.command_line import designs
from tests.validation.blind.compliant_drive.unit import drawn_unit

ROOT = Path(__file__).parents[2]
SEED, UNITS = 31001, 10
"""Of the third simulator's units for tuning."""
OFF = (
    (model_selection, "PAIRS", 10**6),
    (model_selection, "FURTHER_STARTS", 6),
    (fitter, "FIRST_ITERATIONS", fitter.ITERATIONS),
    (model_selection, "FIRST_ITERATIONS", fitter.ITERATIONS),
    (model_selection, "NEAR_MISFIT", np.inf),
    (model_selection, "RIVAL", np.inf),
    (model_selection, "LEAST_DISTANCE", 0.0),
    (model_selection, "FAR_FROM_DECLARED", 0.0),
    (screening, "STARTS", 10**6),
    (screening, "RIVAL", np.inf),
    (screening, "BEST_DIRECTIONS", 10**6),
    (screening, "FAINT", 0.0),
    (screening, "COARSER", 1),
    (screening, "PERIODS", 20),
)
"""Every pair is fitted, every start followed to its end, every direction and period looked at."""


def verdict_on(folder: Path) -> tuple[str, tuple[str, ...]]:
    identification = identify(load_measured_unit(folder, ROOT), no_compliance)
    return identification.verdict.verdict, tuple(sorted(identification.verdict.named_effects))


@pytest.mark.attack
@pytest.mark.parametrize("case", range(UNITS))
def test_a_verdict_is_the_same_without_any_shortcut(case, tmp_path, monkeypatch):
    drawn_unit(SEED, case, designs(ROOT)).write(tmp_path / "unit")
    with_shortcuts = verdict_on(tmp_path / "unit")
    for module, name, value in OFF:
        assert hasattr(module, name)
        monkeypatch.setattr(module, name, value)
    every = pairs.promising_pairs
    monkeypatch.setattr(model_selection, "promising_pairs", lambda *arguments: every(*arguments[:-1], -np.inf))
    print(f"case {case}: {with_shortcuts}", flush=True)
    assert verdict_on(tmp_path / "unit") == with_shortcuts
