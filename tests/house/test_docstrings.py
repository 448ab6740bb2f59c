"""What the style asks of docstrings and a program can hold: exceptions are told, arrays have shape or unit."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
COMMANDS = ROOT / "pipeline/cli"
"""Each command raises InputError, for the one boundary that makes a line of it."""
ARRAY = re.compile(r"\b(Real|Complex|Index|NDArray|ArrayLike)\b")
SHAPE_OR_UNIT = re.compile(r"\((\.\.\.|n\b|n_\w+|[^()]*,[^()]*)\)|\[[^\]]+\]|\bshapes?\b")
TOLD = re.compile(r"\braises?\b|\bRaises\b|Raise |Error\b|errors as `\w+`")


def public_functions(folders: tuple[str, ...]) -> Iterator[tuple[str, ast.FunctionDef]]:
    """Functions and methods without an underscore, each with its place."""
    for path in sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py")):
        for node in ast.parse(path.read_text()).body:
            inner = node.body if isinstance(node, ast.ClassDef) and not node.name.startswith("_") else [node]
            for function in inner:
                if isinstance(function, ast.FunctionDef) and not function.name.startswith("_"):
                    yield f"{path.relative_to(ROOT)}:{function.lineno} {function.name}", function


def raises(function: ast.FunctionDef) -> bool:
    """Whether an exception that is made here leaves the function: not one that it passes on or catches."""
    waiting: list[ast.AST] = list(function.body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Raise) and node.exc is not None:
            return True
        if isinstance(node, ast.Try):
            waiting += [*node.handlers, *node.orelse, *node.finalbody]
        elif not isinstance(node, ast.FunctionDef | ast.Lambda | ast.ClassDef):
            waiting += ast.iter_child_nodes(node)
    return False


def test_a_public_function_that_raises_says_so() -> None:
    guilty, checked = [], 0
    for position, function in public_functions(("pipeline", "stages", "tests/validation")):
        if raises(function) and not position.startswith(str(COMMANDS.relative_to(ROOT))):
            checked += 1
            guilty += [] if TOLD.search(ast.get_docstring(function) or "") else [position]
    assert checked > 40
    assert not guilty


def test_arrays_of_the_mechanics_state_shape_or_unit() -> None:
    guilty, checked = [], 0
    for position, function in public_functions(("pipeline/model",)):
        arguments = (*function.args.args, *function.args.kwonlyargs)
        annotations = [*(argument.annotation for argument in arguments), function.returns]
        text = ast.get_docstring(function)
        if text and any(annotation and ARRAY.search(ast.unparse(annotation)) for annotation in annotations):
            checked += 1
            guilty += [] if SHAPE_OR_UNIT.search(text) else [position]
    assert checked > 60
    assert not guilty
