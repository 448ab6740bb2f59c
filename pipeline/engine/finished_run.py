"""A finished run: its damaged files, its stages that do not fit together, and its RO-Crate.

Source
------
RO-Crate Metadata Specification 1.1, https://w3id.org/ro/crate/1.1: root data entity, data entities, actions.
"""

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.engine.cache import lock_run
from pipeline.engine.record import Manifest, valid
from pipeline.engine.store import MANIFEST, RECORD, Output, content_hashes, read_json, sha256_of
from pipeline.errors import InputError

FILE = "ro-crate-metadata.json"
CONTEXT = ["https://w3id.org/ro/crate/1.1/context", {"sha256": "https://schema.org/sha256"}]


@dataclass(frozen=True)
class Damage:
    """A file of a stage that is "missing", "altered", "extra", or a record "made from another" of the stages there."""

    stage: str
    name: str
    fault: str


def damages(run_folder: Path) -> list[Damage]:
    """Compare every byte of a run, and the set of its files, with its manifest and its records; nothing is written.

    A hash beside a file finds damage, not malice: whoever may write both can make them fit.

    Raises
    ------
    InputError
        If there is no run.
    """
    manifest, outputs = valid(read_json(run_folder / MANIFEST), Manifest), _outputs_of(run_folder)
    if not outputs and manifest is None:
        raise InputError(f"{run_folder}: no run; see {run_folder.parent} for the runs that there are")
    seals = manifest["stages"] if manifest else {}
    damage = [] if manifest else [Damage("", MANIFEST, "altered" if (run_folder / MANIFEST).exists() else "missing")]
    for stage in sorted({*outputs, *seals, *_inputs_named(outputs.values())}):
        output = outputs.get(stage)
        if output is None:
            is_extra = manifest is not None and stage not in seals
            damage.append(
                Damage(stage, RECORD, "missing" if stage not in outputs else "extra" if is_extra else "altered")
            )
        elif manifest and seals.get(stage) != output.record["seal"]:
            damage.append(Damage(stage, RECORD, "altered"))
        damage += [Damage(stage, name, fault) for name, fault in (output.verify() if output else {}).items()]
    return damage + [Damage(stage, RECORD, f"made from another {name}") for stage, name in _mixed(outputs)]


def mixed_stages(run_folder: Path) -> list[str]:
    """A sentence for each stage whose tables have changed since later stages were computed from them.

    A run that was interrupted after an edit, or of which one stage was run alone, has such stages.
    """
    pairs, sentences = _mixed(_outputs_of(run_folder)), []
    for upstream in sorted({name for _, name in pairs}):
        stages = ", ".join(stage for stage, name in pairs if name == upstream)
        sentences.append(
            f"{upstream} of {run_folder.name} has changed since it was used by {stages}: do not join their tables; "
            f"run: python -m pipeline run report --study {run_folder.name}"
        )
    return sentences


def _outputs_of(run_folder: Path) -> dict[str, Output | None]:
    """Stages that have a record, by name; None where it is damaged."""
    return {path.parent.name: Output.open(path.parent) for path in sorted(run_folder.glob(f"[!.]*/{RECORD}"))}


def _mixed(outputs: Mapping[str, Output | None]) -> list[tuple[str, str]]:
    """Stages, each with a stage upstream whose tables are not those that it was made from."""
    sound_outputs = {name: output for name, output in outputs.items() if output}
    present, pairs = content_hashes(sound_outputs), []
    for stage, output in sound_outputs.items():
        inputs = output.record["inputs"]
        changed = {name.partition("/")[0] for name in inputs if inputs[name] != present.get(name)}
        pairs += [(stage, upstream) for upstream in sorted(changed & sound_outputs.keys())]
    return pairs


def _inputs_named(outputs: Iterable[Output | None]) -> set[str]:
    """Stages whose tables the records say that they were made from."""
    return {name.partition("/")[0] for output in outputs if output for name in output.record["inputs"]}


def set_aside(run_folder: Path, damage: Iterable[Damage]) -> bool:
    """Move what is altered or extra out of a run, so that the next one makes it anew; whether anything was moved.

    Nothing is moved out of a run that cannot be written; records are written over by the next run.

    Raises
    ------
    InputError
        If another process writes the run.
    """
    movable = [file for file in damage if file.fault != "missing" and file.name not in (RECORD, MANIFEST)]
    if not movable or not os.access(run_folder, os.W_OK):
        return False
    with lock_run(run_folder):
        for file_damage in movable:
            output = Output.open(run_folder / file_damage.stage)
            if output is not None:
                output.set_aside(file_damage.name)
    return True


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
