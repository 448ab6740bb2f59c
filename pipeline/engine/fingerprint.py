"""What a result depends on: settings, sources, package versions, inputs; and which of them changed."""

import ast
import hashlib
import importlib.metadata
import importlib.util
import json
import os
import platform
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from functools import cache, cached_property, reduce
from pathlib import Path
from typing import Any

from pydantic_core import to_jsonable_python

from pipeline.engine.record import SourceMemory, valid, with_seal
from pipeline.engine.stage import Stage
from pipeline.engine.store import make_way, read_json, write_json
from pipeline.errors import InputError
from pipeline.registry import KINDS, entry_points, places_of

PACKAGES = ("numpy", "scipy", "scikit-fem", "numba", "pyarrow", "pandas")
"""Libraries whose version may change a number."""

OWN_PACKAGES = ("pipeline", "stages")
TEMPLATES = (".html", ".css", ".js")
"""Files beside the modules of a package that are sources too."""
NO_EFFECT = ("pipeline.engine.progress", "pipeline.config.designs.problems")
"""Modules that no value depends on: they show progress, or refuse settings."""
GROUPS = {kind.package: kind.group for kind in KINDS}
"""Packages that import whatever modules lie in them and in their rooms, and the entry points of others' modules."""
BLOCKS = ("body", "orelse", "finalbody", "handlers", "cases")
"""Where statements hold others."""


@dataclass(frozen=True)
class Fingerprint:
    """All that the result of a stage depends on; the number of jobs and the size of a chunk are not in it.

    Attributes
    ----------
    settings : mapping
        Values of the used sections by dotted name ("cycle.crank_deg").
    sources : mapping
        Hash of each source file by its path ("pipeline/model/contact/laws.py"); comments and docstrings do not count.
    packages : mapping
        Version of each library in `PACKAGES`, and of Python.
    inputs : mapping
        Content hash of each upstream table or file ("clearance/gaps").
    """

    stage: str
    settings: Mapping[str, Any]
    sources: Mapping[str, str]
    packages: Mapping[str, str]
    inputs: Mapping[str, str]

    @cached_property
    def key(self) -> str:
        """One hash of it all."""
        return _digest({field.name: getattr(self, field.name) for field in fields(self)})

    @cached_property
    def code(self) -> str:
        """Hash of the sources and packages alone: what a cached computation depends on besides its own key."""
        return code_of(self.sources, self.packages)

    def changes_since(self, record: Mapping[str, Any]) -> list[str]:
        """Plain sentences: what differs from the fingerprint in a stage's record."""
        changes = []
        for name, earlier_value, value in _differences(record["settings"], self.settings):
            changes.append(f"setting {name} changed: {_short(earlier_value)} -> {_short(value)}")
        for name, earlier_value, value in _differences(record["sources"], self.sources):
            changes.append(
                f"source {name} {'added' if earlier_value is _NONE else 'removed' if value is _NONE else 'changed'}"
            )
        for name, earlier_value, value in _differences(record["packages"], self.packages):
            changes.append(f"package {name} {earlier_value} -> {value}")
        for name, _, _ in _differences(record["inputs"], self.inputs):
            changes.append(f"input {name} changed")
        return changes


def code_of(sources: Mapping[str, str], packages: Mapping[str, str]) -> str:
    """One hash of sources and libraries: equal where two machines run the same program."""
    return _digest([sources, packages])


def fingerprint(stage: Stage, study: Any, inputs: Mapping[str, str]) -> Fingerprint:
    """Fingerprint of a stage for a study, given the content hashes of its inputs."""
    sources, packages = source_hashes(stage.module), package_versions()
    return Fingerprint(stage.name, used_settings(stage, study), sources, packages, dict(inputs))


def used_settings(stage: Stage, study: Any) -> dict[str, Any]:
    """Values of a study's sections that a stage uses, by dotted name."""
    sections = {name: reduce(getattr, name.split("."), study) for name in stage.sections}
    return dict(_leaves(to_jsonable_python(sections)))


@cache
def package_versions() -> dict[str, str]:
    """Versions of `PACKAGES` and of Python (its minor version)."""
    python = ".".join(platform.python_version_tuple()[:2])
    return {"python": python} | {name: importlib.metadata.version(name) for name in PACKAGES}


def refuse_changed_sources(stage: Stage, sources: Mapping[str, str]) -> None:
    """Refuse to keep what a stage computed if a source differs from that with which the command began.

    The modules in memory may be those of before, the ones that are imported late those of now.

    Raises
    ------
    InputError
        Names the sources.
    """
    changed = [name for name, _, _ in _differences(sources, source_hashes(stage.module))]
    if changed:
        raise InputError(
            f"{', '.join(changed)}: changed while this command ran; the results of stage {stage.name} may come from "
            "either version and are not kept; run the command again"
        )


def source_hashes(module: str) -> dict[str, str]:
    """Hash of the file of a module and of every own file that it imports, directly or not.

    Of a package that registers parts its other files count as well: templates, and data that its modules read.

    Parameters
    ----------
    module : str
        Dotted name of the root module.

    Returns
    -------
    dict of str to str
        Hash by path relative to the folder that holds the root package.

    Raises
    ------
    TypeError
        If the module has no source file.
    """
    packages = {*OWN_PACKAGES, module.partition(".")[0]}
    hashes: dict[str, str] = {}
    seen_modules: set[str] = set()
    single_files: set[str] = set()
    folder_of = cache(_folder_of)
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name in seen_modules or name in NO_EFFECT or name.partition(".")[0] not in packages:
            continue
        seen_modules.add(name)
        if name.rpartition(".")[0] in single_files:  # a thing in a module, no module
            continue
        root = folder_of(name.partition(".")[0])
        if file := _file_of(name, root):
            path = os.path.join(root, file)
            hashes[file], imports = _source(path, os.stat(path).st_mtime_ns, name)
            if file.endswith("/__init__.py"):  # templates and style sheets of a package
                package = Path(path).parent
                data = [template for template in sorted(os.listdir(package)) if template.endswith(TEMPLATES)]
                place = file.removesuffix("__init__.py")
                hashes |= {place + f: hashlib.sha256((package / f).read_bytes()).hexdigest() for f in data}
                if name in GROUPS:
                    modules = [entry.module for entry in entry_points(GROUPS[name])]
                    registered = {module.partition(".")[0] for module in modules}
                    packages |= registered
                    for top in registered:
                        hashes |= _data_of(top)
                    files = sorted(file.relative_to(package) for file in package.rglob("*.py"))
                    waiting += [".".join((name, *file.with_suffix("").parts)) for file in files] + modules
            else:
                single_files.add(name)
            waiting += reversed(imports)  # a module before the things in it
            waiting.append(name.rpartition(".")[0])
    if not hashes:
        raise TypeError(f"module {module}: no source file found")
    return hashes


def _data_of(top: str) -> dict[str, str]:
    """Hash of each file of a registered package, or beside a registered module, that is no code."""
    root = Path(_folder_of(top))
    files = (file for place in places_of(top) for file in (sorted(place.rglob("*")) if place.is_dir() else [place]))
    files = (file for file in files if file.suffix not in (".py", ".pyc") and file.is_file())
    return {file.relative_to(root).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


def _folder_of(top: str) -> str:
    """Folder that holds a top package, with an ``__init__.py`` or without, or a module; empty if there is none."""
    spec = importlib.util.find_spec(top)
    places = list(spec.submodule_search_locations or ([spec.origin] if spec.origin else ())) if spec else []
    return str(Path(places[0]).parent) if places else ""


def _file_of(name: str, root: str) -> str:
    """File of a module in the folder of its top package; empty if the name is not a module but a thing in one."""
    base = name.replace(".", "/")
    files = (f"{base}/__init__.py", f"{base}.py") if root else ()
    return next((file for file in files if os.path.isfile(os.path.join(root, file))), "")


@contextmanager
def remembered_sources(file: Path) -> Iterator[None]:
    """Within it a source that a run before has read by the same rules is not taken apart again; ``file`` lists them."""
    rules = hashlib.sha256(Path(__file__).read_bytes() + sys.version.encode()).hexdigest()
    content = valid(read_json(file), SourceMemory)
    memory = content["sources"] if content and content["rules"] == rules else {}
    _read_sources.update(memory)
    try:
        yield
    finally:
        if _read_sources.keys() - memory.keys():
            make_way(file)
            write_json(file, with_seal({"rules": rules, "sources": _read_sources}))


_read_sources: dict[str, list[Any]] = {}
"""By the hash of a file and its package: the hash of what it does, and the names it imports."""


@cache
def _source(path: str, _modified_ns: int, name: str) -> tuple[str, Sequence[str]]:
    """Hash of what a file does, and the names it imports; remembered until the file is modified."""
    text = Path(path).read_bytes()
    package = name if os.path.basename(path) == "__init__.py" else name.rpartition(".")[0]
    key = hashlib.sha256(f"{package}\n".encode() + text).hexdigest()
    if key not in _read_sources:
        tree, imports = ast.parse(text), list[str]()
        _strip(tree, package, imports)
        _read_sources[key] = [hashlib.sha256(ast.dump(tree).encode()).hexdigest(), imports]
    digest, names = _read_sources[key]
    return digest, names


def _strip(node: Any, package: str, imports: list[str]) -> None:
    """Take out what has no effect on a result, docstrings and imports for type checkers only, and list the imports.

    Statements alone are gone through, not the expressions in them, which are most of a file.
    """
    if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and _is_text(node.body[:1]):
        del node.body[0]
    for block in (getattr(node, name, []) for name in BLOCKS):
        block[:] = [statement for statement in block if not _for_checkers(statement)]
        for statement in block:
            imports += _imported_names(statement, package)
            _strip(statement, package, imports)


def _is_text(statements: list[Any]) -> bool:
    return any(
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
        for statement in statements
    )


def _for_checkers(statement: Any) -> bool:
    return (
        isinstance(statement, ast.If)
        and ast.unparse(statement.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING")
        and not statement.orelse
    )


def _imported_names(statement: Any, package: str) -> Iterator[str]:
    """What a statement imports, the module and the names of it."""
    if isinstance(statement, ast.Import):
        yield from (alias.name for alias in statement.names)
    elif isinstance(statement, ast.ImportFrom):
        parent_package = package.split(".")[: len(package.split(".")) - statement.level + 1] if statement.level else []
        base = ".".join([*parent_package, *([statement.module] if statement.module else [])])
        yield base
        yield from (f"{base}.{alias.name}" for alias in statement.names)


_NONE = object()


def _differences(record: Mapping[str, Any], current: Mapping[str, Any]) -> Iterator[tuple[str, Any, Any]]:
    for name in sorted({*record, *current}):
        pair = record.get(name, _NONE), current.get(name, _NONE)
        if pair[0] != pair[1]:
            yield name, *pair


def _short(value: Any, width: int = 60) -> str:
    text = "nothing" if value is _NONE else json.dumps(value)
    return text if len(text) <= width else text[: width - 4] + " ..."


def _leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted names and values; a list of plain values is one value."""
    if isinstance(value, dict) and value:
        children = value.items()
    elif isinstance(value, list) and any(isinstance(element, dict | list) for element in value):
        children = dict(enumerate(value)).items()
    else:
        yield name, value
        return
    for key, subkey in children:
        yield from _leaves(subkey, f"{name}.{key}" if name else str(key))


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()
