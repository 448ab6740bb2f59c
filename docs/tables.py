"""The tables of all stages and decisions as Markdown, read from their declarations."""

from pathlib import Path

from pipeline.decisions.allocation import ALLOCATION, CHECK, TRADEOFF
from pipeline.decisions.bounds import BOUNDS, CAPABILITY, CONTRIBUTIONS, STACKS
from pipeline.decisions.joint import JOINTS
from pipeline.decisions.run_comparison import DIFFERENCES, DRIVER_CHANGES, INPUTS
from stages.chain import STAGES

DECISIONS = {
    "compare": (DIFFERENCES, DRIVER_CHANGES, INPUTS),
    "allocate": (ALLOCATION, CHECK, TRADEOFF),
    "bounds": (BOUNDS, STACKS, CONTRIBUTIONS, CAPABILITY),
    "joints": (JOINTS,),
}
"""Tables of other targets."""


def write_tables(folder: Path) -> None:
    """Write ``tables.md`` into ``folder``."""
    lines = []
    for target, tables in ({stage.name: stage.tables for stage in STAGES} | DECISIONS).items():
        for table in tables:
            lines += [f"## {target}/{table.name}", "", f"One row per {table.row_per}.", ""]
            lines += ["| column | unit | meaning |", "|---|---|---|"]
            cells = ((column.name, column.unit, column.meaning.replace("|", "\\|")) for column in table.columns)
            lines += [f"| `{name}` | {unit} | {meaning} |" for name, unit, meaning in cells]
            lines.append("")
    (folder / "tables.md").write_text("\n".join(lines))
