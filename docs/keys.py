"""The keys of all settings files as Markdown, and the signs of the toleranced dimensions."""

from pathlib import Path

from pipeline.cli.keys import describe, examples, file_keys, sign_of
from pipeline.config.dimensions import dimension_library

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
