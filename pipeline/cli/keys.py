"""Commands on the files that a user writes: every key of them, and new ones that run as written.

`keys` lists every key, and the signs of the toleranced dimensions. `new` writes a commented design, study or measured
unit, to be changed number by number.
"""

import argparse
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from pipeline import settings
from pipeline.config.designs.design import Design
from pipeline.config.dimensions import Dimension, dimension_library
from pipeline.config.files.key_reference import Key, keys_of
from pipeline.config.files.section import NAME, NAME_RULE, nearest_name
from pipeline.config.reading import found_file
from pipeline.config.stated_temperature import Temperature
from pipeline.config.studies.study import Study
from pipeline.config.tolerance_notation import NOTATION
from pipeline.engine.store import write_atomic
from pipeline.errors import InputError
from pipeline.identification.bench.instrument_effects import InstrumentEffect
from pipeline.identification.measurement.unit_sections import UnitSettings
from pipeline.model.effects.effect import NEEDS, Effect

PLACEHOLDERS = {"tolerances": "<dimension>", "costs": "<dimension>"}
NOT_IN_FILES = ("name", "design.", "thermal")
"""Fields of the sections that the program sets itself."""
FOLDERS = {"design": "data/designs/*.toml", "study": "data/studies/*.toml", "unit": "data/measured/*/unit.toml"}
ALLOWED_NOTATION = {
    "limits_mm": '"+0.000/-0.004" or "±0.002": limits as on a drawing [mm], in place of lower_um and upper_um',
    "iso": '"6h5": a code of ISO 286, in place of lower_um and upper_um',
    "of": '"diameter" or "radius": what limits_mm are of',
    "position": '"dia 0.02": diameter of a circular zone [mm], for positions; of housing pins: pin_position',
    "convention": '"drawing" (a larger part is positive) or "material_off": sign of limits_mm of a profile, which '
    "needs clearance.disk_reading too",
}
PROFILE_LIMITS = (
    "state convention: a drawing has the other sign; and clearance.disk_reading, which is normal for a profile "
    "tolerance of ISO 1101: 0.008 on the drawing is limits_mm = ±0.004"
)
"""What limits in mm of a profile need."""
GAP_WORDS = {1: "opens gaps", -1: "closes gaps", 0: "either"}


@cache
def file_keys() -> Mapping[str, tuple[Key, ...]]:
    """The keys of a design, a study and a unit file."""
    notation = [
        Key(f"tolerances.<dimension>.{name}", "text", "", "none", ALLOWED_NOTATION[name], "") for name in NOTATION
    ]
    study = [*keys_of(Study, placeholders=PLACEHOLDERS), *notation, *keys_of(Temperature, "temperature.")]
    study.append(Key("design", "text", "", "required", "a design file, or the stem of one in data/designs", ""))
    keys = {"design": [*keys_of(Design)], "study": study, "unit": [*keys_of(UnitSettings)]}
    return {file: tuple(_unique(key for key in of_file if _is_written(file, key))) for file, of_file in keys.items()}


def _is_written(file: str, key: Key) -> bool:
    return file == "unit" or key.path == "design" or not key.path.startswith(NOT_IN_FILES)


def _unique(keys: Iterator[Key]) -> Iterator[Key]:
    """One of the keys that the alternatives of a section share."""
    unique_keys: dict[str, Key] = {}
    for key in keys:
        first_key = unique_keys.setdefault(key.path, key)
        if key.allowed_values not in first_key.allowed_values:
            unique_keys[key.path] = replace(
                first_key, allowed_values=f"{first_key.allowed_values}, {key.allowed_values}"
            )
    yield from unique_keys.values()


@cache
def examples(root: Path) -> Mapping[tuple[str, str], str]:
    """A value of each key from the files of the project, by file and key."""
    texts: dict[tuple[str, str], str] = {}
    for file, pattern in FOLDERS.items():
        for path in sorted(root.glob(pattern)):
            for key, value in written_keys(file, tomllib.loads(path.read_text(encoding="utf-8"))):
                texts.setdefault((file, key), _shortened_text(value))
    return texts


def written_keys(file: str, tables: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """The keys of a parsed file by the names of the reference, with their values."""
    known_keys = {key.path for key in file_keys()[file]}
    for key, value in _flat(tables):
        yield _reference_name(key, known_keys), value


def _flat(value: Any, key: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _flat(inner, (*key, name))
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for entry in value:
            yield from _flat(entry, (*key[:-1], f"{key[-1]}[]"))
    else:
        yield key, value


def _reference_name(key: tuple[str, ...], known_keys: set[str]) -> str:
    """A key with its user's names replaced as in the reference; itself where the reference has none such."""
    for length in range(len(key), 0, -1):  # a table of free names ends in one
        for placeholder in ("<dimension>", "<name>"):
            for position in [None, *range(length)]:
                parts = [placeholder if place == position else part for place, part in enumerate(key[:length])]
                if (name := ".".join(parts)) in known_keys:
                    return name
    return ".".join(key)


def _shortened_text(value: object) -> str:
    text = str(value).lower() if isinstance(value, bool) else f'"{value}"' if isinstance(value, str) else str(value)
    return text if len(text) <= 40 else f"{text[:36]} ..."


def show_keys(options: argparse.Namespace) -> None:
    """Print the keys of all files, of one file, or those that begin with a name."""
    print("\n".join(key_lines(options.name or "")))


def key_lines(name: str) -> Iterator[str]:
    """Lines of the reference.

    Raises
    ------
    InputError
        If no key has this name.
    """
    if name in ("", "study", "tolerances"):
        yield from sign_lines()
    if name == "effects":
        from pipeline.identification.fitting.problem import candidates  # the solvers behind it take a second

        for effect in candidates().values():
            yield f"{effect.name}: {effect.title}"
            yield from (f"  {title}: {text}" for title, text in effect_facts(effect))
    count = 0
    for file, keys in file_keys().items():
        selected_keys = [
            key for key in keys if name in ("", file) or key.path == name or key.path.startswith(f"{name}.")
        ]
        section = None
        for key in selected_keys:
            if key.section != section:
                section = key.section
                yield f"\n[{file} file] {section}"
            count += 1
            yield f"  {key.path}: {describe(key, examples(settings.ROOT).get((file, key.path), ''))}"
    if not count:
        names = {key.path.partition(".")[0] for keys in file_keys().values() for key in keys}
        raise InputError(f"keys {name}: no such key; {nearest_name(name, {*names, *file_keys()})}")


def describe(key: Key, example: str) -> str:
    """Type, unit, default, allowed values and an example of a key in one phrase."""
    parts = [f"{key.kind} [{key.unit}]" if key.unit else key.kind, key.default if key.default == "required" else ""]
    parts += [f"default {key.default}" if key.default not in ("required", "none") else "", key.allowed_values]
    return "; ".join(part for part in [*parts, f"e.g. {example}" if example else ""] if part)


def sign_lines() -> Iterator[str]:
    """What a positive deviation of each dimension does, and the sign that its limits in mm take."""
    yield "Signs: a positive deviation of each dimension, what it does to the gaps, the sign of limits_mm"
    for dimension in dimension_library().values():
        yield f"  {dimension.name}: {'; '.join(sign_of(dimension))}"


def effect_facts(effect: Effect | InstrumentEffect) -> Iterator[tuple[str, str]]:
    """What is known of an effect: titles and texts."""
    yield "part of", "the drive, [effects] of a design" if isinstance(effect, Effect) else "the bench"
    yield "physics", effect.physics
    for parameter in effect.parameters:
        yield parameter.name, parameter.meaning + (f" [{parameter.unit}]" if parameter.unit != "1" else "")
    yield "changes", effect.changes
    yield "shows as", effect.signature
    yield "looks like", ", ".join(effect.confused_with) or "no other effect"
    yield "confirmed by", effect.told_apart_by
    yield "the data need", "; ".join(NEEDS[need] for need in sorted(effect.needs)) or "loops"
    yield "source", effect.source


def sign_of(dimension: Dimension) -> tuple[str, str, str]:
    """Sign of a dimension in words, its effect on the gaps, and the sign of limits in mm."""
    drawing = "as here" if dimension.drawing_sign > 0 else PROFILE_LIMITS
    return dimension.sign, GAP_WORDS[dimension.gap_sign], drawing


BASES = {
    "design": "data/designs/pin_in_hole_39.toml",
    "study": "data/studies/pin_in_hole.toml",
    "unit": "data/measured/friction_example",
}
BASE_DESIGN = 'design = "pin_in_hole_39"'
UNIT_DATA = ("rows.csv", "dimensions.toml")
NEXT_STEP = {
    "design": "next: python -m pipeline new study NAME --design {name}",
    "study": "next: make study STUDY={name}",
    "unit": "next: replace rows.csv by your measured rows, then make identify UNIT={name}",
}
SECTION_LINE = re.compile(r"\[([^\]]+)\]")
KEY_LINE = re.compile(r"([A-Za-z_]\w*) = ")
COMMENT_COLUMN = 48
"""Of a line of the written file."""


def write_new(options: argparse.Namespace) -> None:
    """Write a file of a kind under a name and say what comes next.

    Raises
    ------
    InputError
        If the name is none that a file may have, or is taken.
    """
    kind, name = options.kind, options.name
    if not NAME.fullmatch(name):
        raise InputError(f"new {kind} {name!r}; the name {NAME_RULE.partition(';')[0]}")
    base = settings.ROOT / BASES[kind]
    target = base.parent / name / "unit.toml" if kind == "unit" else base.parent / f"{name}.toml"
    if target.exists():
        raise InputError(f"{settings.shown(target)} exists; take another name, or change that file")
    source = base / "unit.toml" if kind == "unit" else base
    if not source.is_file():
        message = f"{settings.shown(source)}: a new {kind} is written from it; copy it from the checkout"
        raise InputError(message)
    text = source.read_text(encoding="utf-8")
    if kind == "study" and options.design:
        found_file(options.design, settings.ROOT, "designs", [Path(), settings.ROOT])  # says what is missing
        text = _study_of_design(text, options.design)
    text = with_comments(kind, text)
    if kind == "unit":
        for file in UNIT_DATA:
            write_atomic(target.parent / file, (base / file).read_bytes())
    write_atomic(target, text.encode())
    print(f"{kind}: {settings.shown(target)}")
    print(NEXT_STEP[kind].format(name=name))


def _study_of_design(text: str, design: str) -> str:
    """The text of the base study for another design, without what it says of its own."""
    text = re.sub(r"^#.*\n|^description = .*\n| +#.*$", "", text, flags=re.MULTILINE)
    title = f'title = "{Path(design).stem}: spread of backlash, lost motion and torsional rigidity"'
    return re.sub(r"^title = .*$", title, text, flags=re.MULTILINE).replace(BASE_DESIGN, f'design = "{design}"')


def with_comments(kind: str, text: str) -> str:
    """A file with the type, bounds and default of each key behind its line."""
    return "\n".join(_commented_lines(kind, text)) + "\n"


def _commented_lines(kind: str, text: str) -> Iterator[str]:
    yield f"# A {kind} to start from: it runs as it is. All keys: python -m pipeline keys {kind}"
    known_keys, section = {key.path: key for key in file_keys()[kind]}, ""
    for line in text.splitlines():
        if match := SECTION_LINE.match(line):
            section = re.sub(r"^(tolerances|costs)\.\w+", r"\1.<dimension>", f"{match[1]}.")
            section = re.sub(r"^materials\.\w+", "materials.<name>", section)
        match = KEY_LINE.match(line)
        key = known_keys.get(f"{section}{match[1]}") if match else None
        yield f"{line:{COMMENT_COLUMN - 1}} # {describe(key, '')}" if key and "#" not in line else line
