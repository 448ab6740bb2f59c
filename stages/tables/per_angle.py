"""Columns of all samples at each crank angle, kept in a file: a million samples at 31 angles would take 1.5 GB."""

from collections.abc import Mapping, Sequence
from typing import IO

import numpy as np


class PerAngle:
    """Numbers of samples at crank angles that come block by block and are read angle by angle.

    Parameters
    ----------
    file : open for writing and reading, on a disk that has room for them.
    names : of the columns.
    n_angles : rows of a sample, one after the other.
    """

    def __init__(self, file: IO[bytes], names: Sequence[str], n_angles: int) -> None:
        self._file, self._names, self._n_angles = file, tuple(names), n_angles
        self._counts: list[int] = []

    def add(self, columns: Mapping[str, np.ndarray]) -> None:
        """Add columns (n_samples n_angles,) of further samples."""
        block = np.stack([np.asarray(columns[name], float).reshape(-1, self._n_angles).T for name in self._names], 1)
        self._file.write(np.ascontiguousarray(block).data)
        self._counts.append(block.shape[2])

    def columns_at(self, angle: int) -> dict[str, np.ndarray]:
        """Columns (n_samples,) at the angle of a number, as floats."""
        parts, start = [], 0
        for count in self._counts:
            size = len(self._names) * count
            self._file.seek(8 * (start + angle * size))
            parts.append(np.frombuffer(self._file.read(8 * size)).reshape(len(self._names), count))
            start += self._n_angles * size
        return dict(zip(self._names, np.concatenate(parts, axis=1), strict=True))
