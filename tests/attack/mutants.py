"""Mutants: one operator, constant, sign or bound of the program changed at a time, and the tests that must notice.

`python tests/attack/mutants.py --count 200 --seed 1` draws them evenly over the rooms and prints the survivors by room.
One run of all tests under coverage says which tests run a line, and how long each takes; a mutant gets the tests that
run its line, the shortest first, until one fails. A survivor is a line that no test looks at, or a change without
effect; which of the two takes a reader.
"""

import argparse
import ast
import copy
import os
import queue
import random
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Container, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from hashlib import sha256
from itertools import accumulate
from pathlib import Path
from xml.etree import ElementTree

from coverage import CoverageData

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("engine", "statistics", "decisions", "identification", "model")
"""Folders of `pipeline` whose mutants are drawn."""
STORED = ROOT / "data" / "runs" / "mutants"
"""Folder of the coverage of the tests, which is measured again when a source or test has changed."""
SWAPPED: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Lt: ast.LtE, ast.LtE: ast.Lt,
    ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip
"""Operators and bounds, and what takes their place."""
LONGEST = 120
"""Seconds that the traced tests of a mutant take without it, together, and its files; longer ones are left out."""
PYTEST = ("-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not attack")
NOTHING_TO_RUN = 5
"""Exit status of pytest where all tests of the files are for another target."""


@dataclass(frozen=True)
class Mutant:
    """One change of one file: the room, the path in the project, first and last line, what was done, the new text."""

    room: str
    path: Path
    lines: range
    change: str
    text: str

    @property
    def title(self) -> str:
        """Where it is and what it changes."""
        return f"{self.path}:{self.lines[0]} {self.change}"


def places(tree: ast.Module) -> Iterator[ast.expr]:
    """Expressions of functions that can be mutated; annotations, texts and parts of formatted texts cannot."""
    formatted = {part for text in ast.walk(tree) if isinstance(text, ast.JoinedStr) for part in ast.walk(text)}
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            for statement in function.body:
                for node in ast.walk(statement):
                    if isinstance(node, ast.expr) and node not in formatted and _change(copy.copy(node)):
                        yield node


def _change(node: ast.expr) -> str:
    """Mutate a node in place; what was done, empty where it cannot be."""
    if isinstance(node, ast.BinOp | ast.BoolOp) and type(node.op) in SWAPPED:
        operator = type(node.op)
        node.op = SWAPPED[operator]()  # type: ignore[assignment]
        return f"{operator.__name__} -> {SWAPPED[operator].__name__}"
    if isinstance(node, ast.Compare) and type(node.ops[0]) in SWAPPED:
        bound = type(node.ops[0])
        node.ops = [SWAPPED[bound](), *node.ops[1:]]  # type: ignore[list-item]
        return f"{bound.__name__} -> {SWAPPED[bound].__name__}"
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        node.op = ast.UAdd()
        return "- -> +"
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        value = node.value
        node.value = value + 1 if isinstance(value, int) else 1.5 * value + 0.01  # type: ignore[operator]
        return f"{value!r} -> {node.value!r}"
    return ""


def mutant(rng: random.Random, room: str) -> Mutant:
    """A random mutant of a room; the rest of the file is unchanged, letter by letter."""
    while True:
        path = rng.choice(sorted((ROOT / "pipeline" / room).rglob("*.py")))
        text = path.read_text()
        if nodes := list(places(ast.parse(text))):
            node = rng.choice(nodes)
            first, last = node.lineno, node.end_lineno or node.lineno
            rows = text.encode().splitlines(keepends=True)
            head, tail = rows[first - 1][: node.col_offset], rows[last - 1][node.end_col_offset :]
            change = _change(node)
            rows[first - 1 : last] = [head + f"({ast.unparse(node)})".encode() + tail]
            changed = b"".join(rows).decode()
            return Mutant(room, path.relative_to(ROOT), range(first, last + 1), change, changed)


class Coverage:
    """Which tests run a line of the project in a folder, and the seconds of each of them."""

    def __init__(self, home: Path) -> None:
        self.home = home
        if not (STORED / _state()).exists():
            shutil.rmtree(STORED, ignore_errors=True)
            STORED.mkdir(parents=True)
            settings = STORED / "settings"
            settings.write_text("[run]\nsource = pipeline\nrelative_files = true\n")
            options = ["--cov", f"--cov-config={settings}", "--cov-context=test", "--cov-report="]
            _tests_of(home, [*options, f"--junit-xml={STORED / 'times.xml'}", "--ignore=tests/house"])
            (STORED / _state()).touch()
        self.data = CoverageData(str(STORED / "lines"))
        self.data.read()
        self.seconds: dict[str, float] = {}
        for case in ElementTree.parse(STORED / "times.xml").iter("testcase"):
            if case.find("failure") is None and case.find("error") is None:
                test = f"{case.get('classname', '').replace('.', '/')}.py::{case.get('name')}"
                self.seconds[test] = float(case.get("time", 0))

    def batches(self, mutant: Mutant) -> list[list[str]]:
        """Tests that run a line of a mutant, the shortest first, then files that name its module or what is in it.

        Those of them that lie in the three files that name most are the first batch.

        What runs in the setup of one test may be shared with any test of its file. Compiled functions are not traced,
        nor is what runs in a process that a test starts: for these are the files, and tests of modules that import it.
        """
        traced = self._running(mutant.path, mutant.lines) or self._running_importers(mutant.path)
        ranked, named = self._first(sorted(traced, key=self._time)), self._naming(mutant.path)
        near = [test for test in ranked if test.startswith(tuple(named[:3]))]
        return [near, [test for test in ranked if test not in near], self._first(named)]

    def _running(self, path: Path, lines: Container[int]) -> set[str]:
        contexts = self.data.contexts_by_lineno(str(path))
        phases = {phase for line in contexts if line in lines for phase in contexts[line]}
        shared = tuple(phase.split("::")[0] for phase in phases if phase.endswith("|setup"))
        tests = {phase.split("|")[0] for phase in phases} | {test for test in self.seconds if test.startswith(shared)}
        return tests & self.seconds.keys()

    def _running_importers(self, path: Path) -> set[str]:
        module = f"from {'.'.join(path.with_suffix('').parts)} import"
        importers = [file for file in (ROOT / "pipeline").rglob("*.py") if module in file.read_text()]
        return set().union(*(self._running(file.relative_to(ROOT), range(1_000_000)) for file in importers))

    def _first(self, tests: list[str]) -> list[str]:
        ends = accumulate(map(self._time, tests))
        return [test for test, end in zip(tests, ends, strict=True) if end < LONGEST] or tests[:1]

    def _time(self, test: str) -> float:
        """Seconds of a test, or of all tests of a file."""
        return self.seconds.get(test) or sum(self.seconds[name] for name in self.seconds if name.startswith(test))

    def _naming(self, path: Path) -> list[str]:
        """Files of tests, those first that name the module or most of its public functions and classes."""
        module = ".".join(path.with_suffix("").parts)
        names = {node.name for node in ast.parse((ROOT / path).read_text()).body if isinstance(node, DEFINITION)}

        def nearness(text: str) -> int:
            return 10 * (module in text) + len(names & set(re.findall(r"\w+", text)))

        found = {file: nearness(file.read_text()) for file in (self.home / "tests").rglob("test_*.py")}
        near = sorted((file for file in found if found[file] and "attack" not in file.parts), key=lambda f: -found[f])
        return [str(file.relative_to(self.home)) for file in near]


DEFINITION = (ast.FunctionDef, ast.ClassDef)


def _state() -> str:
    """Hash of all sources and tests."""
    files = sorted(file for folder in ("pipeline", "stages", "tests") for file in (ROOT / folder).rglob("*.py"))
    return sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def _tests_of(home: Path, options: Sequence[str], seconds: int = 10_000) -> subprocess.CompletedProcess[str]:
    """Run tests on the project in a folder; its processes end after so many seconds of processor time."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(home / ".compiled"), "PYTHONPATH": str(home)}
    environment["COVERAGE_FILE"] = str(STORED / "lines")
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # sources are parsed once, not for every mutant
    return subprocess.run(
        [sys.executable, *PYTEST, *options],
        cwd=home,
        env=environment,
        capture_output=True,
        text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5)),
    )


def failed_test(home: Path, tests: Sequence[str]) -> str | None:
    """The first test that fails on the project in a folder; "" if one does not end, None if none fails."""
    ran = _tests_of(home, ["-x", "-n", "0", *tests], 6 * LONGEST) if tests else None
    if ran is None or ran.returncode in (0, NOTHING_TO_RUN):
        return None
    found = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - |$)", ran.stdout, re.M)  # a name may have spaces
    return found[1] if found else ""


class Homes:
    """Copies of the project, one for each process, and one without a mutation: a test that fails there says nothing."""

    def __init__(self, folder: Path, jobs: int) -> None:
        ignored = shutil.ignore_patterns(".git", ".venv", "runs", "__pycache__", "build", ".*_cache")
        self.free: queue.SimpleQueue[Path] = queue.SimpleQueue()
        for name in range(jobs + 1):
            home = folder / str(name) / "project"
            shutil.copytree(ROOT, home, ignore=ignored)
            (home / ".venv").symlink_to(ROOT / ".venv")
            if name:
                self.free.put(home)
        self.original = folder / "0" / "project"
        self.coverage = Coverage(self.original)
        self.passed: set[str] = set()

    def outcome(self, mutant: Mutant) -> str:
        """What becomes of a mutant: the test that fails, "does not end", or "" if it survives."""
        home = self.free.get()
        (home / mutant.path).write_text(mutant.text)
        found = (failed_test(home, batch) for batch in self.coverage.batches(mutant))
        failed = next((test for test in found if test is not None), None)
        shutil.copy(ROOT / mutant.path, home / mutant.path)
        self.free.put(home)
        if failed and failed not in self.passed:
            if failed_test(self.original, [failed]) is not None:
                raise RuntimeError(f"{failed} fails without a mutation; mend it first")
            self.passed.add(failed)
        return "" if failed is None else failed or "does not end"


def main() -> None:
    """Draw mutants, run their tests, print the survivors by room and the share that was killed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rooms", nargs="*", default=list(ROOMS))
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    rng, survivors, killed = random.Random(options.seed), defaultdict(list), 0
    mutants = [mutant(rng, options.rooms[number % len(options.rooms)]) for number in range(options.count)]
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(options.jobs) as pool:
        homes = Homes(Path(folder), options.jobs)
        runs = {pool.submit(homes.outcome, drawn): drawn for drawn in mutants}
        for ended in as_completed(runs):
            drawn, outcome = runs[ended], ended.result()
            killed += bool(outcome)
            print(f"{'killed' if outcome else 'SURVIVED':8} {drawn.title} {outcome}", flush=True)
            if not outcome:
                survivors[drawn.room].append(drawn.title)
    for room, lines in survivors.items():
        print(f"{room}: {len(lines)} survived", *lines, sep="\n  ")
    print(f"{killed} of {options.count} killed")


if __name__ == "__main__":
    main()
