"""The examples of the gallery: one for each question, with a title, from the public library and declared packages."""

import ast
import re
import sys
import tomllib
from pathlib import Path

import pytest

import pipeline

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "docs/gallery").glob("plot_*.py"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
BESIDE = {"small", "pipeline"}


def imported(tree: ast.Module) -> set[str]:
    """First names of what a module imports."""
    names = [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
    names += [node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module]
    return {name.partition(".")[0] for name in names}


def test_there_is_an_example_for_each_question():
    assert [int(path.name.split("_")[1]) for path in EXAMPLES] == list(range(1, len(EXAMPLES) + 1))
    assert len(EXAMPLES) >= 8


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_has_a_title_and_uses_the_public_library(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    title, rule, *_ = (ast.get_docstring(tree, clean=False) or "").strip().splitlines()
    assert rule == "=" * len(title)
    declared = [
        *PROJECT["dependencies"],
        *(name for extra in PROJECT["optional-dependencies"].values() for name in extra),
    ]
    packages = {re.split(r"[\[<>=; ]", name)[0].replace("-", "_") for name in declared}
    assert imported(tree) <= packages | BESIDE | sys.stdlib_module_names
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module == "pipeline":
            assert {alias.name for alias in node.names} <= {*pipeline.__all__, "settings"}
