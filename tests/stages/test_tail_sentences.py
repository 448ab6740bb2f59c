"""The answer of the command tails: a sentence for each share and quantile, with its interval or the reason of none."""

import math
from pathlib import Path

import pandas as pd

from pipeline.config import load_study
from pipeline.config.studies.optional import Tails
from pipeline.library.studies import NO_INTERVAL, tail_remarks, tail_sentences

ROOT = Path(__file__).parent.parent.parent


def test_each_row_is_a_sentence_with_its_interval_or_why_there_is_none():
    columns = ("metric", "statistic", "value", "ci_low", "ci_high", "effective")
    rows = [
        ("peak_pressure_MPa", "beyond", 0.0170747, 0.0103359, 0.0266365, 986.03),
        ("peak_pressure_MPa", "p99.73", 4223.81, -math.inf, math.inf, 1764.9),
        ("lost_motion_arcmin", "beyond", 0.00205432, 0.0, 1.0, 4836.05),
        ("lost_motion_arcmin", "p99.73", 2.78842, 2.74344, 2.82253, 4775.1),
    ]
    assert list(tail_sentences(pd.DataFrame(rows, columns=columns))) == [
        "Peak Hertz pressure: 17,100 units in a million are beyond the limit "
        "(interval 10,300 to 26,600; effective sample size 986)",
        f"Peak Hertz pressure: the 99.73 % quantile is 4,224 MPa ({NO_INTERVAL}; effective sample size 1,765)",
        f"Lost motion: 2,050 units in a million are beyond the limit ({NO_INTERVAL}; effective sample size 4,836)",
        "Lost motion: the 99.73 % quantile is 2.788 arcmin (interval 2.743 to 2.823; effective sample size 4,775)",
    ]


def test_units_and_limits_that_the_shares_leave_out_are_said():
    study = load_study("quick", ROOT)
    study = study.model_copy(update={"tails": Tails(units=20_000, solve=1_500)})
    whole, part = (list(tail_remarks(pd.DataFrame({"units": [units]}), study)) for units in (20_000, 19_320))
    assert whole[0].startswith("For the worst value over 2 loaded crank angles")
    assert "About 680 of 20,000 units have no result" in part[1]
    assert "34,000 units in a million" in part[1]
    assert [line for line in whole if "clearance backlash is not among these" in line] == whole[1:]
