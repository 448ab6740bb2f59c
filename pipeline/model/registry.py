"""What is declared one file each: the files of a package, and what installed packages register beside them."""

import importlib
import importlib.metadata
import pkgutil
from typing import Any


def declarations(package: str, attribute: str, group: str) -> dict[str, Any]:
    """The object ``attribute`` of every file of a package, its rooms' too, and of every entry point, by its ``name``.

    Parameters
    ----------
    package : dotted name; files whose name begins with an underscore declare nothing, nor does one without the object.
    attribute : "EFFECT", "METRIC".
    group : of entry points, through which another package declares one from outside.

    Raises
    ------
    ValueError
        If a registered object has the name of another one.
    """
    paths = importlib.import_module(package).__path__
    names = sorted(file.name for file in pkgutil.walk_packages(paths, f"{package}."))
    modules = [importlib.import_module(name) for name in names if not name.rpartition(".")[2].startswith("_")]
    objects = {declared.name: declared for module in modules if (declared := getattr(module, attribute, None))}
    for entry in sorted(importlib.metadata.entry_points(group=group), key=lambda entry: entry.name):
        declared = entry.load()
        if declared.name in objects:
            raise ValueError(f"{entry.value}: {declared.name} is declared already; give it another name")
        objects[declared.name] = declared
    return objects
