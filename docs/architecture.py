"""Pictures of the house, drawn from its imports: the rooms in the order of pyproject.toml, and the chain of stages."""

import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path

import grimp

ROOT = Path(__file__).parent.parent
LETTER, HEIGHT, GAP, ROW = 5.5, 40, 34, 88
"""Width of a letter of a note, height of a box, between two boxes, and from row to row [px]."""
Edges = Mapping[str, set[str]]


def reduced(edges: Edges) -> dict[str, set[str]]:
    """Edges of a graph without circles, less those that a longer path says too."""

    def reached(node: str) -> set[str]:
        return set().union(*({neighbour} | reached(neighbour) for neighbour in edges.get(node, ())))

    return {
        node: {a for a in nodes_after if not any(a in reached(b) for b in nodes_after)}
        for node, nodes_after in edges.items()
    }


def svg(rows: Sequence[Sequence[str]], edges: Edges, notes: Mapping[str, str]) -> str:
    """Boxes in rows from top to bottom, with a line for each edge; ``notes`` stand under the names."""
    box_width = max(150, LETTER * max(map(len, notes.values())) + 16)
    width = max(map(len, rows)) * (box_width + GAP) + GAP
    centre = {
        name: (width / 2 + (column - (len(row) - 1) / 2) * (box_width + GAP), GAP + HEIGHT / 2 + i * ROW)
        for i, row in enumerate(rows)
        for column, name in enumerate(row)
    }
    height = GAP * 2 + HEIGHT + (len(rows) - 1) * ROW
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" '
        'font-family="sans-serif" text-anchor="middle">',
        f'<rect width="{width}" height="{height}" fill="white"/>',
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<path d="M0 0 8 4 0 8z" fill="#7a8794"/></marker></defs>',
    ]
    for name, nodes_after in sorted(edges.items()):
        x, y = centre[name]
        for x_end, y_end in sorted(centre[room] for room in nodes_after):
            start, end = y + HEIGHT / 2, y_end - HEIGHT / 2
            bend = (start + end) / 2
            path = f"M{x:.0f} {start:.0f}C{x:.0f} {bend:.0f} {x_end:.0f} {bend:.0f} {x_end:.0f} {end:.0f}"
            lines.append(f'<path d="{path}" fill="none" stroke="#7a8794" marker-end="url(#tip)"/>')
    for name, (x, y) in centre.items():
        box = f'x="{x - box_width / 2:.0f}" y="{y - HEIGHT / 2:.0f}" width="{box_width:.0f}" height="{HEIGHT}"'
        lines.append(f'<rect {box} rx="5" fill="#eef3f7" stroke="#44546a"/>')
        lines.append(f'<text x="{x:.0f}" y="{y - 2:.0f}" font-size="14" fill="#1b2733">{name}</text>')
        lines.append(f'<text x="{x:.0f}" y="{y + 13:.0f}" font-size="10" fill="#44546a">{notes[name]}</text>')
    return "\n".join([*lines, "</svg>", ""])


def room_pictures() -> dict[str, str]:
    """One picture for each contract on layers: the rooms and the imports between them, by the contract's id."""
    graph = grimp.build_graph("pipeline", "stages", "tests", cache_dir=None)
    pictures = {}
    for contract in tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]:
        if contract["type"] != "layers":
            continue
        prefix = "".join(f"{container}." for container in contract.get("containers", ()))
        rows = [[prefix + room.strip() for room in re.split(r"[|:]", layer)] for layer in contract["layers"]]
        files = {room: {room} | graph.find_descendants(room) for row in rows for room in row}
        imported = {
            room: set().union(*(graph.find_modules_directly_imported_by(module) for module in modules))
            for room, modules in files.items()
        }
        edges = {a: {b for b in files if b != a and imported[a] & files[b]} for a in files}
        short = {room: room.removeprefix(prefix or "pipeline.") for room in files}
        pictures[contract["id"]] = svg(
            [[short[room] for room in row] for row in rows],
            {short[a]: {short[b] for b in rooms_after} for a, rooms_after in reduced(edges).items()},
            {short[room]: f"{len(modules)} file{'s' * (len(modules) > 1)}" for room, modules in files.items()},
        )
    return pictures


def chain_picture() -> str:
    """The stages, each under those that it reads, with the names of its tables."""
    from stages.chain import STAGES

    reads = {stage.name: set(stage.reads) for stage in STAGES}
    depth: dict[str, int] = {}
    for stage in STAGES:
        depth[stage.name] = 1 + max((depth[name] for name in stage.reads), default=-1)
    rows = [[name for name in depth if depth[name] == level] for level in range(max(depth.values()) + 1)]
    stages_before = reduced(reads)
    edges = {name: {reader for reader in stages_before if name in stages_before[reader]} for name in stages_before}
    return svg(rows, edges, {stage.name: ", ".join(table.name for table in stage.tables) for stage in STAGES})


def draw(folder: Path) -> None:
    """Write all pictures into ``folder``."""
    folder.mkdir(exist_ok=True)
    for name, picture in {**room_pictures(), "chain": chain_picture()}.items():
        (folder / f"{name}.svg").write_text(picture)
