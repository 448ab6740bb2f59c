"""The keys of all settings files as Markdown, the signs of the toleranced dimensions, and the library of effects."""

from pathlib import Path

from pipeline.cli.keys import describe, effect_facts, examples, file_keys, sign_of
from pipeline.config.dimensions import dimension_library
from pipeline.identification.fitting.problem import candidates

TITLES = {"design": "Design files", "study": "Study files", "unit": "Unit files"}


def write_keys(folder: Path) -> None:
    """Write ``keys.md`` into ``folder``."""
    lines = ["## Signs of the dimensions", "", "| dimension | positive | gaps | sign of `limits_mm` |"]
    lines.append("|---|---|---|---|")
    lines += [f"| `{name}` | {' | '.join(sign_of(item))} |" for name, item in dimension_library().items()]
    for file, keys in file_keys().items():
        lines += ["", f"## {TITLES[file]}", "", "| key | value |", "|---|---|"]
        for key in keys:
            value = describe(key, examples(folder.parents[1]).get((file, key.path), ""))
            lines.append(f"| `{key.path}` | {value.replace('<', '&lt;').replace('>', '&gt;')} |")
    (folder / "keys.md").write_text("\n".join(lines) + "\n")


def write_effects(folder: Path) -> None:
    """Write ``effects.md`` into ``folder``."""
    lines = []
    for effect in candidates().values():
        lines += [f"## `{effect.name}`", "", f"{effect.title[0].upper()}{effect.title[1:]}.", "", "| | |", "|---|---|"]
        parameters = {parameter.name for parameter in effect.parameters}
        for title, text in effect_facts(effect):
            lines.append(f"| {f'`{title}`' if title in parameters else title} | {text} |")
        lines.append("")
    (folder / "effects.md").write_text("\n".join(lines))
