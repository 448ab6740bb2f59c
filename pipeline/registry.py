"""What is declared one file each: the kinds of it, found in the files of a package and in what others register."""

import importlib
import importlib.metadata
import pkgutil
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Kind:
    """A kind of thing that is declared one file each.

    Attributes
    ----------
    package : dotted name; its files and those of its rooms declare one each. A file whose name begins with an
        underscore declares nothing, nor does one without the object.
    attribute : the object of a file, "EFFECT".
    group : of entry points, in which another package registers one from outside (name = "module:EFFECT").
    """

    package: str
    attribute: str
    group: str

    def declarations(self) -> dict[str, Any]:
        """The object of every file and of every entry point, by its ``name``.

        Raises
        ------
        ValueError
            If two objects have one name: a file that was copied and not renamed, or what another package registers.
        """
        paths = importlib.import_module(self.package).__path__
        files = (file.name for file in pkgutil.walk_packages(paths, f"{self.package}."))
        module_names = sorted(name for name in files if not name.rpartition(".")[2].startswith("_"))
        declared = [(name, getattr(importlib.import_module(name), self.attribute, None)) for name in module_names]
        entries = sorted(importlib.metadata.entry_points(group=self.group), key=lambda entry: entry.name)
        declared += [(entry.value, entry.load()) for entry in entries]
        objects: dict[str, Any] = {}
        for place, item in declared:
            if item is None:
                continue
            if item.name in objects:
                raise ValueError(f"{place}: {item.name} is declared already; give it another name")
            objects[item.name] = item
        return objects


CONTACT_LAWS = Kind("pipeline.model.contact.line_laws", "LAW", "cycloid_contact_laws")
DIMENSIONS = Kind("pipeline.config.dimensions", "DIMENSION", "cycloid_dimensions")
DISTRIBUTIONS = Kind("pipeline.config.distributions", "DISTRIBUTION", "cycloid_distributions")
EFFECTS = Kind("pipeline.model.effects", "EFFECT", "cycloid_effects")
METRICS = Kind("pipeline.model.metrics", "METRIC", "cycloid_metrics")
OUTPUT_MECHANISMS = Kind("pipeline.config.mechanisms", "MECHANISM", "cycloid_output_mechanisms")
REPORT_SECTIONS = Kind("pipeline.report.sections", "SECTION", "cycloid_report_sections")
TURN_METRICS = Kind("pipeline.model.metrics.turn", "TURN_METRIC", "cycloid_turn_metrics")
KINDS = (
    CONTACT_LAWS,
    DIMENSIONS,
    DISTRIBUTIONS,
    EFFECTS,
    METRICS,
    OUTPUT_MECHANISMS,
    REPORT_SECTIONS,
    TURN_METRICS,
)
