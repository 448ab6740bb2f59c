"""What the identification reaches on blind units, each rate with its one-sided 95 % bound."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import beta

from pipeline.engine.store import write_atomic
from pipeline.figures.style import INK, new_figure, save, with_style
from pipeline.identification.selection.criteria import LARGEST_CLASS
from pipeline.identification.selection.statements.verdict import ADEQUATE, UNEXPLAINED
from tests.validation.blind.generate import COMPLIANT, ELASTIC, NONE, ONE, OUTSIDE_KIND, RIGID, TWO
from tests.validation.blind.run import VISIBLE, Row

LEVEL = 0.95
"""Confidence of the one-sided bounds of a rate."""
BINS = (1.0, 2.0, 3.0, 6.0, 12.0, 40.0)
"""Edges of the sizes in noise floors by which rates are shown apart."""
HELD_OUT = 1.15
"""Noise floors that the error left may have in the median, so that half of the units have no more."""
CLEAR = 1.25
"""Distance from every effect of the library, in noise, from which one outside it can be told apart."""
SECONDS = 10.0
"""Time that an identification should take [s]."""


@dataclass(frozen=True)
class Rate:
    """A share of the cases.

    Attributes
    ----------
    name : what is counted.
    sizes : of the effects, or "all".
    passed, trials : counts.
    least : least rate that is asked for, or NaN.
    """

    name: str
    sizes: str
    passed: int
    trials: int
    least: float = float("nan")

    @property
    def rate(self) -> float:
        return self.passed / self.trials if self.trials else float("nan")

    @property
    def bound(self) -> float:
        """The rate is larger with a confidence of 95 % (Clopper and Pearson)."""
        return lower_bound(self.passed, self.trials)

    @property
    def upper_bound(self) -> float:
        """The rate is smaller with a confidence of 95 % (Clopper and Pearson)."""
        return 1.0 - lower_bound(self.trials - self.passed, self.trials)

    @property
    def met(self) -> bool | None:
        """Whether the rate itself reaches what is asked for; None where nothing is, or there are no cases."""
        return None if np.isnan(self.least) or not self.trials else self.rate >= self.least


def lower_bound(successes: int, trials: int, level: float = LEVEL) -> float:
    """One-sided lower bound of a share by Clopper and Pearson, Biometrika 26 (1934) 404; 0 without cases."""
    return float(beta.ppf(1 - level, successes, trials - successes + 1)) if successes and trials else 0.0


def rates(rows: Sequence[Row]) -> list[Rate]:
    """The numbers to meet; the same of each simulator's units; then by size of the effect and the oracle's own."""
    requirements = numbers_to_meet(rows)
    halves = [
        replace(rate, name=f"{simulator} simulator: {rate.name}")
        for simulator in (ELASTIC, RIGID, COMPLIANT)
        for rate in numbers_to_meet([row for row in rows if row.simulator == simulator])
    ]
    return [*requirements, *halves, *by_size([row for row in rows if row.kind == ONE])]


def numbers_to_meet(rows: Sequence[Row]) -> list[Rate]:
    """Rates of some units over all sizes of what was put into them."""
    kinds = {kind: [row for row in rows if row.kind == kind] for kind in (NONE, ONE, TWO, OUTSIDE_KIND)}
    visible = [row for row in kinds[ONE] if row.size_over_noise >= VISIBLE]
    separable = [row for row in visible if row.oracle_separates]
    visible_outside = [row for row in kinds[OUTSIDE_KIND] if row.size_over_noise >= VISIBLE]
    clear = [row for row in visible_outside if row.nearest_floors >= CLEAR]
    right = [row for row in kinds[ONE] if row.correct]
    with_interval = [row for row in right if row.parameter_covered is not None]
    large = f">= {VISIBLE:g}"
    return [
        _rate("one effect: right, or in a class of at most three", large, visible, lambda r: r.correct, 0.95),
        _rate("one effect, oracle separates: named alone", large, separable, _alone, 0.8),
        _rate("one effect: oracle separates it", large, visible, lambda r: bool(r.oracle_separates)),
        _rate("no effect: none named", "all", kinds[NONE], lambda r: r.correct, 0.98),
        _rate("no effect: adequate", "all", kinds[NONE], lambda r: r.verdict == ADEQUATE),
        _rate("outside: unexplained", large, visible_outside, lambda r: r.verdict == UNEXPLAINED, 0.95),
        _rate("outside, clear: unexplained", large, clear, lambda r: r.verdict == UNEXPLAINED, 0.95),
        _rate("outside: nothing named", "all", kinds[OUTSIDE_KIND], lambda r: not r.named, 0.98),
        _rate("two effects: both named together", "all", kinds[TWO], lambda r: bool(r.both)),
        _rate("two effects: one or both named", "all", kinds[TWO], lambda r: r.correct),
        _rate(f"right effect: error left at most {HELD_OUT:g} floors", "all", right, _fits, 0.5),
        _rate(f"right effect: at most {HELD_OUT:g} times what a right model leaves", "all", right, _as_expected, 0.5),
        _rate("right effect: true parameters in their intervals", "all", with_interval, _covered, 0.9),
        _rate(f"at most {SECONDS:g} s", "all", rows, lambda r: r.seconds <= SECONDS, 1.0),
    ]


def by_size(singles: Sequence[Row]) -> list[Rate]:
    """Rates of units with one effect by its size, and of classes by theirs."""
    size_rates = []
    for low, high in zip(BINS[:-1], BINS[1:], strict=True):
        rows_of_size = [row for row in singles if low <= row.size_over_noise < high]
        span = f"{low:g} to {high:g}"
        size_rates.append(
            _rate("one effect: right, or in a class of at most three", span, rows_of_size, lambda r: r.correct)
        )
        size_rates.append(_rate("one effect: named alone", span, rows_of_size, _alone))
    for size in sorted({row.class_size for row in singles}):
        size_rates.append(_rate(f"one effect: class of {size}", "all", singles, partial(_of_class, size)))
    return size_rates


def _rate(
    name: str, sizes: str, rows: Sequence[Row], passes: Callable[[Row], bool], required_share: float = float("nan")
) -> Rate:
    return Rate(name, sizes, sum(passes(row) for row in rows), len(rows), required_share)


def _alone(row: Row) -> bool:
    return row.correct and row.class_size == 1


def _of_class(size: int, row: Row) -> bool:
    return row.class_size == size


def _covered(row: Row) -> bool:
    return bool(row.parameter_covered)


def _as_expected(row: Row) -> bool:
    return row.rms_after_arcmin <= HELD_OUT * row.rms_expected_arcmin


def _fits(row: Row) -> bool:
    return row.rms_after_arcmin <= HELD_OUT * row.noise_floor_arcmin


def write_rates(path: Path, rates: Sequence[Rate]) -> None:
    """rates.csv."""
    lines = ["rate,size_over_noise,passed,of,share,lower_bound_95,upper_bound_95,needed,met"]
    for rate in rates:
        required = "" if np.isnan(rate.least) else f"{rate.least:g}"
        outcome = "" if rate.met is None else str(rate.met).lower()
        share = "" if not rate.trials else f"{rate.rate:.4f}"
        bounds = f"{rate.bound:.4f},{rate.upper_bound:.4f}"
        lines.append(f'"{rate.name}",{rate.sizes},{rate.passed},{rate.trials},{share},{bounds},{required},{outcome}')
    write_atomic(path, ("\n".join(lines) + "\n").encode())


def confusion(rows: Sequence[Row]) -> dict[tuple[str, str], int]:
    """Cases by truth and what was named: the class, or the verdict where nothing was."""
    counts: dict[tuple[str, str], int] = {}
    for row in rows:
        key = _truth(row), row.named or row.verdict
        counts[key] = counts.get(key, 0) + 1
    return counts


def write_confusion(path: Path, counts: dict[tuple[str, str], int]) -> None:
    """confusion.csv, one line a cell that is not zero."""
    lines = ["truth,named,cases", *(f"{truth},{answer},{n}" for (truth, answer), n in sorted(counts.items()))]
    write_atomic(path, ("\n".join(lines) + "\n").encode())


def write_reports(rows: Sequence[Row], folder: Path) -> None:
    """rates.csv, confusion.csv and figures/confusion in the run's folder."""
    write_rates(folder / "rates.csv", rates(rows))
    write_confusion(folder / "confusion.csv", confusion(rows))
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    save(confusion_figure(rows), folder / "figures" / "confusion")


def _truth(row: Row) -> str:
    return "two effects" if row.kind == TWO else row.truth


def _said(row: Row) -> list[str]:
    """The names over which a case's count is shared."""
    if not row.named:
        return [row.verdict]
    return row.named.split(";") if row.class_size <= LARGEST_CLASS else ["unresolved"]


@with_style
def confusion_figure(rows: Sequence[Row]) -> Figure:
    """Truth against what was named; a case whose class has n members counts 1/n for each."""
    truths = sorted({_truth(row) for row in rows}, key=lambda name: (name != "none", ":" in name, name))
    answers = sorted(
        {name for row in rows for name in _said(row)}, key=lambda name: (name in truths, name), reverse=True
    )
    counts = np.zeros((len(truths), len(answers)))
    for row in rows:
        names = _said(row)
        for name in names:
            counts[truths.index(_truth(row)), answers.index(name)] += 1 / len(names)
    figure = new_figure(1.6 + 0.24 * len(truths), 2.5 + 0.32 * len(answers))
    axes = figure.add_subplot()
    axes.grid(visible=False)
    axes.imshow(counts, cmap="Blues", vmin=0, vmax=max(1.5 * counts.max(), 1), aspect="auto")
    for i, j in zip(*np.nonzero(counts), strict=True):
        axes.text(j, i, f"{counts[i, j]:.2g}", ha="center", va="center", color=INK, fontsize=7.5)
    axes.set_xticks(range(len(answers)), answers, rotation=60, ha="right")
    axes.set_yticks(range(len(truths)), truths)
    axes.set(xlabel="named, or the verdict where nothing was", ylabel="truth")
    axes.set_title("What was there and what was named, cases")
    return figure
