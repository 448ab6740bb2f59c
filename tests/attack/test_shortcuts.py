"""Shortcuts of the search change its time and no verdict: drawn units with all of them off."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.identification import identify as identification
from pipeline.identification.bench import load_path, simulator
from pipeline.identification.fitting import fitter, least_squares
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.identification.selection import model_selection, pairs, ripples, screening
from tests.validation.blind.catalogue import no_compliance
from tests.validation.blind.command_line import designs
from tests.validation.blind.compliant_drive.unit import drawn_unit

ROOT = Path(__file__).parents[2]
SEED, UNITS = 31001, 10
"""Of the third simulator's units for tuning."""
OFF = (
    (load_path, "REPEATED_SHARE", 0.0),
    (simulator, "BEYOND", 1.2),
    (simulator, "BEYOND_TURNING", 1.6),
    (fitter, "SCALES_MOVED", 0.0),
    (fitter, "ITERATIONS", 45),
    (fitter, "FIRST_ITERATIONS", 45),
    (fitter, "LOADS", (0.8, 0.6, 0.5, 0.4, 0.3, 0.2, 0.15, 0.1, 0.05)),
    (least_squares, "SETTLED_CHANGE", 0.005),
    (least_squares, "FIRST_DAMPING", 1e-2),
    (least_squares, "LEAST_DAMPING", 1e-8),
    (least_squares, "DAMPING_INCREASE", 4.0),
    (least_squares, "TRIES", 10),
    (least_squares, "SPREADS", (1.0,) * 6 + (0.5,) * 4 + (0.25,) * 4),
    (least_squares, "PAIRS_OF_DRAWS", 32),
    (least_squares, "AVERAGED_DAMPING", 1e-3),
    (model_selection, "PAIRS", 10**6),
    (model_selection, "ADDITIONS", 10**6),
    (screening, "FIRST_ITERATIONS", 45),
    (screening, "FIRST_SHARE", 0.2),
    (screening, "EDGE", 0.005),
    (model_selection, "RIVAL", np.inf),
    (model_selection, "FAR_FROM_DECLARED", 0.0),
    (fitter, "FALL_OF_PASS", 0.2),
    (fitter, "FALL_OF_LARGE_MISFIT", 0.0),
    (model_selection, "LEAST_GAIN", 0.1),
    (model_selection, "LARGEST_GAIN", 1e6),
    (model_selection, "CLOSE_ODDS", 200.0),
    (model_selection, "RESTARTS", 24),
    (model_selection, "WELL_FITTED", 0.0),
    (fitter, "WELL_FITTED", 0.0),
    (ripples, "WELL_FITTED", 0.0),
    (fitter, "PASSES", 10),
    (model_selection, "MOST_REFINED", 10**6),
    (pairs, "LARGEST_AMOUNT", 3.0),
    (screening, "STEPS", (1e-3, 3e-3, 1e-2, 3e-2, 1e-1)),
    (screening, "SHAPES", (0.1, 0.2, 0.35, 0.5, 0.6, 0.7, 0.85)),
    (screening, "REACH", 8.0),
    (screening, "LOOKED_AT", 10**6),
    (screening, "STARTS", 10**6),
    (screening, "RIVAL", np.inf),
    (screening, "RADII", (0.15, 0.05, 0.1, 0.2, 0.35)),
    (screening, "PHASES", 16),
    (screening, "BEST_DIRECTIONS", 10**6),
    (ripples, "WAVE_STEP", 0.25),
    (ripples, "FINER", 21),
    (ripples, "FAINT", 0.0),
    (ripples, "PERIODS", 20),
    (ripples, "FOLLOWED", 20),
)
"""Every pair is fitted, every start followed to its end, every direction and period looked at; fits settle later."""


def verdict_on(folder: Path) -> tuple[str, tuple[str, ...]]:
    verdict = identification.identify(load_measured_unit(folder, ROOT), no_compliance).verdict
    return verdict.verdict, tuple(sorted(verdict.named_effects))


@pytest.mark.attack
@pytest.mark.parametrize("case", range(UNITS))
def test_a_verdict_is_the_same_without_any_shortcut(case, tmp_path, monkeypatch):
    drawn_unit(SEED, case, designs(ROOT)).write(tmp_path / "unit")
    with_shortcuts = verdict_on(tmp_path / "unit")
    for module, name, value in OFF:
        assert hasattr(module, name)
        monkeypatch.setattr(module, name, value)
    monkeypatch.setattr(identification, "_is_held_by_range", lambda *_: True)
    every = pairs.promising_pairs
    monkeypatch.setattr(model_selection, "promising_pairs", lambda *arguments: every(*arguments[:-1], -np.inf))
    print(f"case {case}: {with_shortcuts}", flush=True)
    assert verdict_on(tmp_path / "unit") == with_shortcuts
