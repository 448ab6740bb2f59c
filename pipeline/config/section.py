"""What all sections of a design or study file share: frozen, strict, no unknown keys; and how a problem reads."""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
# Deviations beyond a millimetre are no tolerances of a reducer but a value typed in another unit.
Micrometres = Annotated[float, Field(ge=-1000, le=1000)]


class Section(BaseModel):
    """A table of a TOML file: immutable, without unknown keys, without silent conversion ("50" is no number)."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


MISSING = object()
"""Stands for the value of a key that is not in the file."""


@dataclass(frozen=True)
class Problem:
    """One mistake in a file.

    Parameters
    ----------
    key : dotted key of the value, e.g. "tolerances.pin_radial.sigma_um".
    found : the value as it stands in the file; MISSING without the key; None where the mistake is not the value.
    allowed : what may stand there ("must be >= 0") and, where it is not obvious, what to do.
    """

    key: str
    found: object
    allowed: str

    def line(self, file: str) -> str:
        """The problem in one line: where, what was found, what is allowed."""
        if self.found is MISSING:
            shown = " is missing"
        else:
            shown = "" if self.found is None else f" = {json.dumps(self.found, default=str)}"
        return f"{file}: {self.key}{shown}; {self.allowed}"


def nearest_name(name: str, known: Iterable[str]) -> str:
    """The advice for an unknown `name`: the most similar of the `known` names, else all of them."""
    names = sorted(known)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    return f"did you mean {close[0]!r}?" if close else f"known names: {', '.join(names)}"
