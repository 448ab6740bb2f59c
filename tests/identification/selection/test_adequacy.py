"""The test that ``adequate`` and every name have to pass."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.identification.selection.adequacy import failed_test

RNG = np.random.default_rng(4)
BLOCKS, CELLS, SIGMA, LEVEL = 24, 20, 0.2, 3.0
N = BLOCKS * CELLS


def outcome(missed, curves=None, open_share=0.0, in_sample=False, form=0.3, named=False):
    """Why a model fails whose predictions miss by so much [noise], with a share of variance that was left open.

    The other of the two models, with effects or without, is far off in all of them.
    """
    block = np.repeat(np.arange(BLOCKS), CELLS)
    data = SimpleNamespace(angle=LEVEL + SIGMA * missed, sigma=np.full(N, SIGMA), block=block)
    right = np.array([N * (1 + open_share), 2.0 * N * (1 + open_share) ** 2])
    folds = SimpleNamespace(
        cells=np.ones(N, bool),
        recalibrated_curve=np.full(N, LEVEL + 9.0 * named),
        best_curve=np.full(N, LEVEL + 9.0 * (not named)),
        right_recalibrated=right if not named else np.zeros(2),
        right_best=right if named else np.zeros(2),
        in_sample=in_sample,
    )
    return failed_test(data, folds, curves or {}, form, named)


@pytest.mark.parametrize("named", [False, True])
def test_noise_passes_and_what_no_right_model_leaves_does_not(named):
    noise = RNG.standard_normal(N)
    assert outcome(noise, named=named) == ""
    assert "1.5 times what a right model" in outcome(1.5 * noise / np.std(noise), named=named)
    assert outcome(1.5 * noise / np.std(noise), open_share=1.5, named=named) == ""
    assert outcome(np.full(N, np.nan), named=named)


def test_noise_alone_fails_in_few_draws():
    failures = sum(bool(outcome(RNG.standard_normal(N), form=0.0)) for _ in range(300))
    assert 3 <= failures <= 30


def test_a_baseline_that_is_ahead_is_said():
    wave = 0.5 * np.sin(np.arange(N) / 7.0)
    noise = RNG.standard_normal(N)
    reason = outcome(noise + wave, {"replay": LEVEL + SIGMA * wave}, form=1.0)
    assert reason == "replay predicts unused data better"
    assert outcome(noise, {"replay": LEVEL + SIGMA * wave}) == ""


def test_a_baseline_that_is_ahead_by_what_is_left_open_is_not_ahead_of_a_right_model():
    noise, missed = RNG.standard_normal(N), 0.45
    replay = {"replay": np.full(N, LEVEL + SIGMA * missed)}
    assert outcome(noise + missed, replay, form=1.0) == "replay predicts unused data better"
    assert outcome(noise + missed, replay, open_share=1.2 * missed**2, form=1.0) == ""


def test_what_holds_nothing_out_is_not_tested():
    assert "nothing is held out" in outcome(RNG.standard_normal(N), in_sample=True)
