"""Every test that the table of promises names exists."""

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent


def test_every_test_that_a_promise_names_exists() -> None:
    text = (ROOT / "docs/promises.md").read_text()
    rows = [line for line in text.splitlines() if line.startswith("| ") and not line.startswith("| promise")]
    assert len(rows) >= 20
    for row in rows:
        names = re.findall(r"(test_\w+\.py)(?:::(test_\w+))?", row)
        assert names or "not held by a test yet" in row, row
        for name, test in names:
            (path,) = (ROOT / "tests").rglob(name)
            assert f"def {test}" in path.read_text(), f"{name}::{test}"
