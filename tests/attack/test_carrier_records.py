"""Records of RV reducers of the second simulator, judged: what they have is named, what they lack is not."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.identification.record.answer import record_answer
from pipeline.identification.record.evidence import RecordEvidence, points_of
from pipeline.identification.record.judging import Judgement
from pipeline.identification.record.terms import base_terms
from pipeline.identification.record.turn_record import TurnRecord
from pipeline.identification.selection.statements.verdict import ADEQUATE, WITHIN_TOLERANCE
from tests.validation.blind.carrier_record import Bench, Curves, Truth, record, reducer, solved, write_record

ROOT = Path(__file__).parents[2]
FIRST_SEED, SEEDS = 27510, 10
TRUTHS = {
    "": Truth(),
    "friction_crank_once": Truth(friction_wave=0.4),
    "friction_over_temperature": Truth(warm_friction=0.5),
    "zero_over_temperature": Truth(warm_zero_arcsec=5.0),
    "outside": Truth(outside_arcsec=5.0),
}
"""By the effect of the library that they are; "" and "outside" are none of them."""
SEPARABLE = 25.0
"""Whitened chi-square of the true effect after the refit without it beyond which it must be named."""


@dataclass(frozen=True)
class Case:
    """What was said of a record.

    Attributes
    ----------
    effect : that it has; see ``TRUTHS``.
    separation : whitened chi-square of that effect after the refit.
    """

    effect: str
    separation: float
    judgement: Judgement

    @property
    def is_named(self) -> bool:
        """Whether the effect is named, and no other one beside it."""
        return self.judgement.named_effects == (self.effect,)


def read(folder: Path, ratio: float, curves: Curves, bench: Bench, truth: Truth, seed: int) -> TurnRecord:
    """A record as the program reads it from its files."""
    table = record(ratio, curves, bench, truth, np.random.default_rng(seed))
    return TurnRecord.read(load_measured_unit(write_record(folder, table), ROOT))


def separation(without: TurnRecord, turn: TurnRecord) -> float:
    """Whitened chi-square of what a record has more than another of the same noise, after the refit without it.

    The covariance is that of the record without: noise, and the structure of its largest evidence.
    """
    points, values = points_of(without), []
    change = points_of(turn).error - points.error
    structure = RecordEvidence(points, base_terms(without), []).most_likely(())
    for error in (0 * change, change):
        evidence = RecordEvidence(points, base_terms(without), [])
        evidence.columns[:, -1] = error
        values.append(evidence.posterior((), structure).value)
    return 2 * (values[0] - values[1])


def cases(folder: Path, seed: int) -> list[Case]:
    """One reducer with a record for each truth; what is separable is known before any effect is looked for."""
    rng, bench = np.random.default_rng(seed), Bench()
    drive, smooth_bench = reducer(rng, Truth()), replace(bench, step_arcsec=1e-6)
    curves, found = solved(drive, bench), []
    for number, (effect, truth) in enumerate(TRUTHS.items()):
        drawn = replace(truth, friction=rng.uniform(6.0, 12.0), load_friction=rng.uniform(0.005, 0.015))
        plain = replace(Truth(), friction=drawn.friction, load_friction=drawn.load_friction)
        without, smooth, turn = (
            read(folder / f"{seed}{effect}{kind}", drive.ratio, curves, of_bench, what, 10 * seed + number)
            for kind, of_bench, what in (
                ("without", smooth_bench, plain),
                ("smooth", smooth_bench, drawn),
                ("", bench, drawn),
            )
        )
        case = Case(effect, separation(without, smooth), record_answer(turn).judgement)
        said = case.judgement.verdict, case.judgement.members, case.judgement.finding
        print(seed, effect or "none", f"{case.separation:.0f}", *said, flush=True)
        found.append(case)
    return found


@pytest.mark.attack
def test_records_of_a_second_simulator_are_named_by_what_they_have(tmp_path: Path) -> None:
    found = [case for k in range(SEEDS) for case in cases(tmp_path, FIRST_SEED + k)]
    single = [case for case in found if case.effect not in ("", "outside") and case.separation > SEPARABLE]
    empty = [case for case in found if not case.effect]
    right = sum(case.is_named for case in single)
    verdicts = [case.judgement.verdict for case in empty]
    adequate, tolerated = verdicts.count(ADEQUATE), verdicts.count(WITHIN_TOLERANCE)
    print(f"{right} of {len(single)} separable effects named; of {len(empty)} empty:", adequate, "adequate,", tolerated)
    assert len(single) >= 2 * SEEDS
    assert right >= 0.9 * len(single)
    assert adequate + tolerated >= 0.9 * len(empty)
    assert not any(case.judgement.members for case in found if case.effect in ("", "outside"))
