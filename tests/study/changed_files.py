"""Files of a design and of a study with changes."""

import copy
from pathlib import Path

from pipeline.config import load_design

ROOT = Path(__file__).parents[2]


def read_design(name):
    return load_design(name, ROOT)


def changed(data, key, value):
    """A copy of `data` with the dotted `key` set, or removed where the value is None."""
    data = copy.deepcopy(data)
    *sections, field = key.split(".")
    table = data
    for section in sections:
        table = table.setdefault(section, {})
    if value is None:
        del table[field]
    else:
        table[field] = value
    return data
