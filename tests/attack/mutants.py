"""Mutants: one operator, constant, sign or bound of the program changed at a time, and the tests that must notice.

`python tests/attack/mutants.py --count 200 --seed 1` draws them evenly over the rooms, runs the tests of each mutant's
room on a copy of the project, and prints the survivors by room. A survivor is a line that no test looks at, or a change
without effect; which of the two takes a reader.
"""

from __future__ import annotations

import argparse
import ast
import copy
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TESTS = {
    "pipeline/engine": ("tests/engine",),
    "pipeline/statistics": ("tests/statistics", "tests/verification/statistics"),
    "pipeline/decisions": ("tests/verification/decisions", "tests/study/test_costs.py"),
    "pipeline/identification/measurement": (
        "tests/identification/measurement",
        "tests/identification/test_generic_drive.py",
    ),
    "pipeline/identification/fitting": ("tests/identification/fitting",),
    "pipeline/identification/selection": ("tests/identification/selection", "tests/identification/fitting"),
    "pipeline/model/contact": ("tests/model/test_contact.py", "tests/model/equilibrium"),
    "pipeline/model/geometry": ("tests/model/geometry",),
    "pipeline/model/load_history": ("tests/model/load_history", "tests/model/effects"),
}
"""Tests that are run on a mutant of each room."""
SWAPPED: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Lt: ast.LtE, ast.LtE: ast.Lt,
    ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip
"""Operators and bounds, and what takes their place."""
LONGEST = 900
"""Seconds of processor time of the tests on a mutant, after which it counts as killed: it does not end."""
KILLED, UNENDED, SURVIVED = "killed", "no end", "SURVIVED"


def places(tree: ast.Module) -> Iterator[ast.AST]:
    """Nodes of functions that can be mutated; annotations and texts cannot."""
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            for statement in function.body:
                for node in ast.walk(statement):
                    if _change(copy.copy(node)):
                        yield node


def _change(node: ast.AST) -> str:
    """Mutate a node in place; what was done, empty where it cannot be."""
    if isinstance(node, ast.BinOp | ast.BoolOp) and type(node.op) in SWAPPED:
        before = type(node.op)
        node.op = SWAPPED[before]()  # type: ignore[assignment]
        return f"{before.__name__} -> {type(node.op).__name__}"
    if isinstance(node, ast.Compare) and type(node.ops[0]) in SWAPPED:
        before = type(node.ops[0])
        node.ops = [SWAPPED[before](), *node.ops[1:]]  # type: ignore[list-item]
        return f"{before.__name__} -> {type(node.ops[0]).__name__}"
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        node.op = ast.UAdd()
        return "- -> +"
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        node.value = node.value + 1 if isinstance(node.value, int) else 1.5 * node.value + 0.01
        return f"constant -> {node.value}"
    return ""


def mutant(rng: random.Random, room: str) -> tuple[Path, int, str, str, str]:
    """File, line, change, mutated text and name of the function of a random mutant of a room."""
    while True:
        path = rng.choice(sorted((ROOT / room).rglob("*.py")))
        tree = ast.parse(path.read_text())
        nodes = list(places(tree))
        if nodes:
            node = rng.choice(nodes)
            line, change = node.lineno, _change(node)  # type: ignore[attr-defined]
            function = next(f.name for f in ast.walk(tree) if isinstance(f, ast.FunctionDef) and node in ast.walk(f))
            return path.relative_to(ROOT), line, change, ast.unparse(tree), function


def nearest_first(tests: tuple[str, ...], path: Path, function: str) -> list[str]:
    """The files of tests, those first that name the mutated function, its public neighbours or its module.

    A test that fails ends the run: the nearest are the likeliest, and the room is gone through for survivors alone.
    """
    module = ".".join(path.with_suffix("").parts)
    names = [node.name for node in ast.parse((ROOT / path).read_text()).body if isinstance(node, DEFINITION)]
    public = [name for name in names if not name.startswith("_")]

    def nearness(file: Path) -> int:
        text = file.read_text()
        words = set(re.findall(r"\w+", text))
        return -(100 * (function in words) + 10 * (module in text) + sum(name in words for name in public))

    found = {file for test in tests for file in _test_files(ROOT / test)}
    found |= {file for file in _test_files(ROOT / "tests") if module in file.read_text() and "attack" not in file.parts}
    return [str(file.relative_to(ROOT)) for file in sorted(found, key=nearness)]


DEFINITION = (ast.FunctionDef, ast.ClassDef)


def _test_files(path: Path) -> list[Path]:
    return sorted(path.rglob("test_*.py")) if path.is_dir() else [path]


def failed_test(home: Path, tests: Sequence[str]) -> str | None:
    """The first test that fails on the project in a folder; "" if it does not end, None if all pass."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(home / ".compiled"), "OMP_NUM_THREADS": "1"}
    environment["PYTHONPATH"] = str(home)
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "0", "-p", "no:cacheprovider", *tests]
    process = subprocess.run(command, cwd=home, env=environment, capture_output=True, text=True, preexec_fn=_limited)
    if process.returncode in (0, NOTHING_TO_RUN):
        return None
    found = re.search(r"^(?:FAILED|ERROR) (\S+)", process.stdout, re.M)
    return found[1] if found else ""


NOTHING_TO_RUN = 5
"""Exit status of pytest where all tests of the files are for another target."""


def _limited() -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (LONGEST, LONGEST + 5))


class Original:
    """The project without a mutation: a test that fails there too says nothing of a mutant."""

    def __init__(self, home: Path) -> None:
        self.home, self.passed = home, dict[str, bool]()

    def passes(self, test: str) -> bool:
        """Whether a test passes on it."""
        if test not in self.passed:
            self.passed[test] = failed_test(self.home, [test]) is None
        return self.passed[test]


def main() -> None:
    """Draw mutants, run their tests, print the survivors by room and the share that was killed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rooms", nargs="*", default=list(TESTS))
    options = parser.parse_args()
    rng, survivors, killed = random.Random(options.seed), defaultdict(list), 0
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder) / "project"
        shutil.copytree(
            ROOT, home, ignore=shutil.ignore_patterns(".git", ".venv", "runs", "__pycache__", "build", ".*_cache")
        )
        (home / ".venv").symlink_to(ROOT / ".venv")
        original = Original(home)
        for number in range(options.count):
            room = options.rooms[number % len(options.rooms)]
            path, line, change, text, function = mutant(rng, room)
            (home / path).write_text(text)
            failed = failed_test(home, nearest_first(TESTS[room], path, function))
            shutil.copy(ROOT / path, home / path)
            if failed and not original.passes(failed):
                sys.exit(f"{failed} fails without a mutation; mend it first")
            outcome = SURVIVED if failed is None else KILLED if failed else UNENDED
            killed += failed is not None
            print(f"{outcome:8} {path}:{line} {change} {failed or ''}", flush=True)
            if failed is None:
                survivors[room].append(f"{path}:{line} {change}")
    for room, lines in survivors.items():
        print(f"{room}: {len(lines)} survived", *lines, sep="\n  ")
    print(f"{killed} of {options.count} killed")


if __name__ == "__main__":
    main()
