"""Models made of the effects of a fit, and where the fit stands of their unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.identification.fitting.parameters import Fit, Vector
from pipeline.identification.fitting.problem import Candidate, Model


def less(fit: Fit, effect_name: str) -> tuple[Model, Vector]:
    """The model of a fit less one of its effects, and where the fit stands of its unknowns."""
    parts = fit.model.split(fit.unknowns.shares.tolist())
    return of_parts(fit, [part for part in parts if part[0].name != effect_name])


def of_parts(fit: Fit, parts: Sequence[tuple[Candidate, Sequence[float]]]) -> tuple[Model, Vector]:
    """The model of effects with their shares, and these in place of those of a fit's unknowns."""
    shares = np.array([share for _, effect_shares in parts for share in effect_shares])
    return Model(tuple(effect for effect, _ in parts)), replace(fit.unknowns, shares=shares)
