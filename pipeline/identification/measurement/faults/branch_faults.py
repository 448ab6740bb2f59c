"""Faults of cycles and branches: what is missing of them, told once a kind."""

from collections.abc import Iterator, Sequence

import numpy as np

from pipeline.arrays import Truth
from pipeline.identification.measurement.branches import BranchBlocks
from pipeline.identification.measurement.enough import FEWEST_PIECE_ROWS
from pipeline.identification.measurement.faults.fault import SHOWN_ROWS, Fault, fault_of_rows
from pipeline.identification.measurement.rows import Rows

FEWEST_BLOCKS = 8
"""Blocks below which no effect can be accepted (design of the identification)."""


def branch_faults(rows: Rows, blocks: BranchBlocks, usable: Truth) -> Iterator[Fault]:
    """Cycles that are missing or do not load in both senses, and branches of too few rows."""
    yield from _missing(rows)
    yield from _one_sense(rows, blocks, usable)
    yield from _few_point_faults(rows, blocks, usable)


def _name_list(names: Sequence[str]) -> str:
    """The first of some names, and how many there are beyond."""
    remainder_text = f" and {len(names) - SHOWN_ROWS} more" if len(names) > SHOWN_ROWS else ""
    return ", ".join(names[:SHOWN_ROWS]) + remainder_text


def _missing(rows: Rows) -> Iterator[Fault]:
    gap_names = []
    for position, crank in enumerate(rows.cranks):
        cycles = np.unique(rows.cycle[(rows.position == position) & ~rows.is_misnumbered])
        gaps = np.setdiff1d(np.arange(cycles.min(), cycles.max() + 1), cycles) if cycles.size else cycles
        gap_names += [f"cycle {gap} at crank {crank:g} deg" for gap in gaps]
    if gap_names:
        yield Fault("missing cycle", f"{_name_list(gap_names)} is not there", "note")


def _one_sense(rows: Rows, blocks: BranchBlocks, usable: Truth) -> Iterator[Fault]:
    names, is_chosen = [], np.zeros(len(rows), bool)
    for position, crank in enumerate(rows.cranks):
        for cycle in np.unique(rows.cycle[(rows.position == position) & ~rows.is_misnumbered]):
            branches = (blocks.position == position) & (blocks.cycle == cycle)
            of_cycle = (rows.position == position) & (rows.cycle == cycle) & usable
            torque = rows.torque[of_cycle]
            if branches.sum() < 2 or not torque.size or torque.min() * torque.max() >= 0:
                names.append(f"cycle {cycle} at crank {crank:g} deg")
                is_chosen |= of_cycle
    if names:
        message = f"{_name_list(names)}: the usable rows do not load and unload in both senses"
        yield fault_of_rows(rows, is_chosen, "one sense", "note", message)


def _few_point_faults(rows: Rows, blocks: BranchBlocks, usable: Truth) -> Iterator[Fault]:
    counts = np.array([usable[span].sum() for span in blocks.rows], dtype=int)
    short = np.flatnonzero(counts < FEWEST_PIECE_ROWS)
    if short.size:
        names = [
            f"crank {rows.cranks[blocks.position[b]]:g} deg, cycle {blocks.cycle[b]}, branch {blocks.branch[b]}"
            for b in short
        ]
        chosen_rows = np.concatenate([np.arange(blocks.start[b], blocks.stop[b]) for b in short])
        message = f"fewer than {FEWEST_PIECE_ROWS} usable rows on {_name_list(names)}"
        yield fault_of_rows(rows, chosen_rows, "too few points", "note", message)
    branches = int(np.sum(counts >= FEWEST_PIECE_ROWS))
    if branches < FEWEST_BLOCKS:
        text = (
            f"{branches} branches (position x cycle x sense) of {FEWEST_PIECE_ROWS} rows or more, {FEWEST_BLOCKS} are "
            "needed: no effect can be accepted; measure more cycles or positions"
        )
        yield Fault("too few points", text, "note" if branches > 1 else "fatal")
