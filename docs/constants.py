"""The numeric constants of the program as Markdown, read from its sources: name, value, and what each stands for."""

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parent.parent
FOLDERS = ("pipeline", "stages", "tests/validation")
KINDS = tuple(
    statement.targets[0].id
    for statement in ast.parse((ROOT / "pipeline" / "constant_kinds.py").read_text()).body
    if isinstance(statement, ast.Assign)
)
"""Names of the kinds of constants that steer no verdict."""


@dataclass(frozen=True)
class Constant:
    """A number at the top of a module; `meaning` is the text below or beside it, empty where there is none.

    `kind` is the annotation, empty where there is none.
    """

    module: str
    name: str
    value: str
    meaning: str
    kind: str

    @property
    def steers_identification(self) -> bool:
        """Whether it belongs to the identification and is not declared as a kind that steers no verdict."""
        return self.module.startswith("pipeline.identification.") and self.kind not in KINDS


def constants() -> Iterator[Constant]:
    """Every numeric constant of a module, in the order of the files."""
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield from _of_module(path)


def _of_module(path: Path) -> Iterator[Constant]:
    source = path.read_text()
    lines, body = source.splitlines(), ast.parse(source).body
    for statement, following in zip(body, [*body[1:], None], strict=False):
        if not (isinstance(statement, ast.Assign | ast.AnnAssign) and statement.value and _numeric(statement.value)):
            continue
        target = statement.targets[0] if isinstance(statement, ast.Assign) else statement.target
        meaning = _text(following) or lines[statement.lineno - 1].partition("#")[2].strip() or _above(lines, statement)
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        kind = ast.unparse(statement.annotation) if isinstance(statement, ast.AnnAssign) else ""
        yield Constant(module, ast.unparse(target), ast.unparse(statement.value), meaning, kind)


def _numeric(value: ast.expr) -> bool:
    """Whether an expression is a number, or a tuple of numbers."""
    match value:
        case ast.Constant(value=bool()):
            return False
        case ast.Constant(value=int() | float()):
            return True
        case ast.UnaryOp(operand=operand):
            return _numeric(operand)
        case ast.BinOp(left=left, right=right):
            return _numeric(left) or _numeric(right)
        case ast.Tuple(elts=elements):
            return bool(elements) and all(map(_numeric, elements))
    return False


def _text(statement: ast.stmt | None) -> str:
    """The words of a statement that is a text and nothing else."""
    match statement:
        case ast.Expr(value=ast.Constant(value=str() as text)):
            return " ".join(text.split())
    return ""


def _above(lines: list[str], statement: ast.stmt) -> str:
    line_above = lines[statement.lineno - 2].strip()
    return line_above.lstrip("# ") if line_above.startswith("#") else ""


def write_constants(folder: Path) -> None:
    """Write ``constants.md`` into ``folder``."""
    lines, module = [], ""
    for constant in constants():
        if constant.module != module:
            module = constant.module
            lines += ["", f"## {module}", "", "| constant | kind | value | meaning |", "|---|---|---|---|"]
        meaning = constant.meaning.replace("|", "\\|").replace("*", "\\*")
        lines.append(f"| `{constant.name}` | {constant.kind} | `{constant.value}` | {meaning} |")
    (folder / "constants.md").write_text("\n".join(lines))


if __name__ == "__main__":
    print(sum(constant.steers_identification for constant in constants()), "constants steer the identification")
