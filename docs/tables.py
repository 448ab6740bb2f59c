"""The tables of all stages as Markdown, read from their declarations."""

from pathlib import Path

from stages.chain import STAGES


def write_tables(folder: Path) -> None:
    """Write ``tables.md`` into ``folder``."""
    lines = []
    for stage in STAGES:
        for table in stage.tables:
            lines += [f"## {stage.name}/{table.name}", "", f"One row per {table.row_per}.", ""]
            lines += ["| column | unit | meaning |", "|---|---|---|"]
            cells = ((column.name, column.unit, column.meaning.replace("|", "\\|")) for column in table.columns)
            lines += [f"| `{name}` | {unit} | {meaning} |" for name, unit, meaning in cells]
            lines.append("")
    (folder / "tables.md").write_text("\n".join(lines))
