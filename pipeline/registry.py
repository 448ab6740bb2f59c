"""What is declared, alone in a file or in a table: the kinds of it, found in a package and in what others register."""

import importlib
import importlib.metadata
import importlib.util
import os
import pkgutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from typing import Any

from pipeline.errors import InputError


def entry_points(group: str) -> EntryPoints:
    """What installed packages register in a group; read again where a folder of the path has changed."""
    folders = [path for path in sys.path if os.path.exists(path or ".")]
    groups = _all_groups(tuple((path, os.stat(path or ".").st_mtime_ns) for path in folders))
    entries: EntryPoints = groups.select(group=group)
    return entries


@lru_cache(maxsize=1)
def _all_groups(_stamps: Sequence[tuple[str, int]]) -> Any:
    return importlib.metadata.entry_points()


@dataclass(frozen=True)
class Kind:
    """A kind of thing that is declared.

    Attributes
    ----------
    package : dotted name; its files and those of its rooms declare one each, or several as a table. A file whose name
        begins with an underscore declares nothing, nor does one without the object.
    attribute : the object of a file, "EFFECT"; a table of them, a tuple, has the plural "EFFECTS".
    group : of entry points, in which another package registers one from outside (name = "module:EFFECT").
    """

    package: str
    attribute: str
    group: str

    def declarations(self) -> dict[str, Any]:
        """Every object of the files, alone or in a table, and of the entry points, by its ``name``.

        Raises
        ------
        InputError
            If two objects have one name: a file that was copied and not renamed, or what another package registers; or
            if what another package registers cannot be loaded or has no name.
        """
        paths = importlib.import_module(self.package).__path__
        files = (file.name for file in pkgutil.walk_packages(paths, f"{self.package}."))
        module_names = sorted(name for name in files if not name.rpartition(".")[2].startswith("_"))
        declared = [(name, item) for name in module_names for item in self._of_module(name)]
        entries = sorted(entry_points(self.group), key=lambda entry: entry.name)
        declared += [(entry.value, _loaded(entry)) for entry in entries]
        objects: dict[str, Any] = {}
        for place, item in declared:
            if item.name in objects:
                raise InputError(f"{place}: {item.name} is declared already; give it another name")
            objects[item.name] = item
        return objects

    def _of_module(self, name: str) -> tuple[Any, ...]:
        module = vars(importlib.import_module(name))
        alone, table = module.get(self.attribute), module.get(f"{self.attribute}S")
        return (*([] if alone is None else [alone]), *(table if isinstance(table, tuple) else ()))


def _loaded(entry: EntryPoint) -> Any:
    """What an entry point names; whatever fails in it is told with its package."""
    owner = f"package {entry.dist.name}" if entry.dist else "an installed package"
    advice = "mend that package or uninstall it"
    try:
        item = entry.load()
    except Exception as error:  # any code of another package
        problem = f"{type(error).__name__}: {error}"
        raise InputError(f"{entry.group}: {entry.name} = {entry.value} of {owner}: {problem}; {advice}") from error
    if not isinstance(getattr(item, "name", None), str):
        found = f"is {type(item).__name__}, which has no name"
        raise InputError(f"{entry.group}: {entry.name} = {entry.value} of {owner}: {found}; {advice}")
    return item


CONTACT_LAWS = Kind("pipeline.model.contact.line_laws", "LAW", "cycloid_contact_laws")
DIMENSIONS = Kind("pipeline.config.dimensions", "DIMENSION", "cycloid_dimensions")
DISTRIBUTIONS = Kind("pipeline.config.distributions", "DISTRIBUTION", "cycloid_distributions")
EFFECTS = Kind("pipeline.model.effects", "EFFECT", "cycloid_effects")
METRICS = Kind("pipeline.model.metrics", "METRIC", "cycloid_metrics")
OUTPUT_MECHANISMS = Kind("pipeline.config.mechanisms", "MECHANISM", "cycloid_output_mechanisms")
REPORT_SECTIONS = Kind("pipeline.report.sections", "SECTION", "cycloid_report_sections")
TURN_METRICS = Kind("pipeline.model.metrics.turn", "TURN_METRIC", "cycloid_turn_metrics")
KINDS = (CONTACT_LAWS, DIMENSIONS, DISTRIBUTIONS, EFFECTS, METRICS, OUTPUT_MECHANISMS, REPORT_SECTIONS, TURN_METRICS)


def places_of(top: str) -> list[Path]:
    """Folders of a package, with an ``__init__.py`` or without; the files of a module's name, whatever their ending."""
    spec = importlib.util.find_spec(top)
    if spec is None:
        return []
    if spec.submodule_search_locations:
        return [Path(place) for place in spec.submodule_search_locations]
    return sorted(Path(spec.origin).parent.glob(f"{top}.*")) if spec.origin else []


def registered_places() -> list[Path]:
    """Folders, or files of single modules, of other packages that register what is declared."""
    modules = {entry.module.partition(".")[0] for kind in KINDS for entry in entry_points(kind.group)}
    return [place for module in sorted(modules) for place in places_of(module)]
