"""How far a run stays inside what the contact laws hold for, in words."""

from collections.abc import Iterator

import numpy as np

from pipeline.report.frames import Frames
from pipeline.report.layout.wording import DASH, count_text, listed_text, percent


def beyond_law(frames: Frames) -> str:
    """Share of the pins' moment on contacts beyond the range of their law, at the largest torque of the cycle."""
    curves = frames.curves
    torque = np.abs(curves["torque_Nm"].to_numpy())
    has_failed = curves["sample"].isin(frames.failed_rows["sample"]).to_numpy()
    shares = curves["beyond_limit_share"].to_numpy()[(torque >= (1 - 1e-9) * torque.max()) & ~has_failed]
    if not shares.size:
        return DASH
    return f"{percent(float(shares.mean()))} on average and {percent(float(shares.max()))} at most"


def overload_phrases(frames: Frames) -> list[str]:
    """Contacts of the drawn samples beyond the pressure limit, one phrase a sample; none without a limit."""
    limit = frames.limits.get("peak_pressure_MPa")
    return [] if limit is None else list(_overload_phrases(frames, limit))


def _overload_phrases(frames: Frames, limit: float) -> Iterator[str]:
    loads = frames.at_crank(frames.loads)
    for label, sample in frames.samples_drawn.items():
        rows = loads[loads["sample"] == sample]
        if not len(rows):
            continue
        contacts_beyond = rows.loc[rows["pressure_MPa"] > limit, "contact"].unique()
        pins = sorted(int(contact) for contact in contacts_beyond if contact < frames.study.design.cycloid.pins)
        rollers = len(contacts_beyond) - len(pins)
        parts = [f"{count_text(len(pins), 'pin')} ({ranges(pins)})"] if pins else []
        parts += [count_text(rollers, frames.study.design.output.words.contact)] if rollers else []
        yield f"{listed_text(parts) if parts else 'none'} of {frames.owner(label)}"


def ranges(numbers: list[int]) -> str:
    """Ascending numbers with their runs joined: ``3, 70–75``."""
    runs: list[list[int]] = []
    for item in numbers:
        if runs and item == runs[-1][1] + 1:
            runs[-1][1] = item
        else:
            runs.append([item, item])
    return ", ".join(
        f"{run_start}" if run_start == run_end else f"{run_start}\u2013{run_end}" for run_start, run_end in runs
    )
