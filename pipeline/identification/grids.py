"""Where an effect is looked at before it is fitted."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product


def grid(bounds: Sequence[tuple[float, float]]) -> list[tuple[float, ...]]:
    """Shares of the bounds at which a model is looked at first, none of them without the effect."""
    several = len(bounds) > 1
    axes: list[tuple[float, ...]] = []
    for low, high in bounds:
        zero = -low / (high - low)
        steps = (0.1, 0.5) if several else (0.006, 0.02, 0.06, 0.2, 0.5)
        if low > 0:
            axes.append((0.1, 0.35, 0.6, 0.85))
        elif low == 0:
            axes.append((0.01, 0.04, 0.15, 0.4) if several else (0.003, 0.01, 0.03, 0.1, 0.25, 0.5))
        else:
            up, down = [zero + step * (1 - zero) for step in steps], [zero - step * zero for step in steps]
            axes.append((*down, zero, *up) if several else (*down, *up))
    nothing = [-low / (high - low) for low, high in bounds]
    return [point for point in product(*axes) if any(p != none for p, none in zip(point, nothing, strict=True))]
