"""A run as an RO-Crate: every file with its hash, every stage with its inputs, versions and time, for whoever gets it.

Source
------
RO-Crate Metadata Specification 1.1, https://w3id.org/ro/crate/1.1: root data entity, data entities, actions.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pipeline.engine.runner import damages
from pipeline.engine.store import RECORD, Output, sha256_of
from pipeline.errors import InputError

FILE = "ro-crate-metadata.json"
CONTEXT = ["https://w3id.org/ro/crate/1.1/context", {"sha256": "https://schema.org/sha256"}]


def crate(run_folder: Path) -> dict[str, Any]:
    """The metadata of a run's crate; every file is compared with its record first.

    Raises
    ------
    InputError
        If there is no run, or a file of it is damaged.
    """
    folders = sorted(path.parent for path in run_folder.glob(f"[!.]*/{RECORD}"))
    outputs = {folder.name: output for folder in folders if (output := Output.open(folder))}
    if not outputs:
        raise InputError(f"{run_folder}: no run; see {run_folder.parent} for the runs that there are")
    if damage := damages(run_folder):
        raise InputError(
            f"{run_folder / item.stage / item.name}: {item.fault}; see: python -m pipeline check {run_folder.name}"
            for item in damage
        )
    files = [entity for stage, output in outputs.items() for entity in _files(stage, output)]
    latest = max(output.record["started"] for output in outputs.values())
    root = {
        "@id": "./",
        "@type": "Dataset",
        "name": f"run {run_folder.name}",
        "description": "A study, stage by stage: tables, pages, and what each was made from.",
        "datePublished": latest,
        "license": {"@id": "#license"},
        "hasPart": [{"@id": entity["@id"]} for entity in files],
        "mentions": [{"@id": f"#{stage}"} for stage in outputs],
    }
    descriptor = {
        "@id": FILE,
        "@type": "CreativeWork",
        "conformsTo": {"@id": "https://w3id.org/ro/crate/1.1"},
        "about": {"@id": "./"},
    }
    owner = {"@id": "#license", "@type": "CreativeWork", "name": "stated by whoever hands the run on"}
    actions = [_action(stage, output) for stage, output in outputs.items()]
    return {"@context": CONTEXT, "@graph": [descriptor, root, owner, *_programs(outputs), *actions, *files]}


def _files(stage: str, output: Output) -> Iterator[dict[str, Any]]:
    for path in sorted(path for path in output.folder.rglob("*") if path.is_file()):
        yield {
            "@id": f"{stage}/{path.relative_to(output.folder).as_posix()}",
            "@type": "File",
            "name": path.name,
            "contentSize": str(path.stat().st_size),
            "sha256": sha256_of(path),
        }


def _action(stage: str, output: Output) -> dict[str, Any]:
    """One stage: what it read, with the hashes of that, what it wrote, and with which versions."""
    record = output.record
    settings = {f"setting {name}": value for name, value in record["settings"].items()}
    hashes = {f"input {name}": digest for name, digest in record["inputs"].items()}
    properties = {**settings, **hashes, "seconds": record["seconds"], "key": record["key"]}
    return {
        "@id": f"#{stage}",
        "@type": "CreateAction",
        "name": stage,
        "startTime": record["started"],
        "instrument": [{"@id": f"#{name}-{version}"} for name, version in record["packages"].items()],
        "object": [{"@id": f"#{name}"} for name in sorted({path.partition("/")[0] for path in record["inputs"]})],
        "result": [{"@id": entity["@id"]} for entity in _files(stage, output)],
        "description": "; ".join(f"{name}: {value}" for name, value in properties.items()),
    }


def _programs(outputs: Mapping[str, Output]) -> Iterator[dict[str, Any]]:
    versions = {item for output in outputs.values() for item in output.record["packages"].items()}
    for name, version in sorted(versions):
        yield {"@id": f"#{name}-{version}", "@type": "SoftwareApplication", "name": name, "softwareVersion": version}
