"""Every number at the top of a module says what it stands for."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))

from constants import constants  # noqa: E402  of the pages

from tests.attack.test_shortcuts import OFF  # noqa: E402


def test_every_numeric_constant_is_explained() -> None:
    numbers = list(constants())
    assert len(numbers) > 300
    assert [f"{number.module}.{number.name}" for number in numbers if not number.meaning] == []


def test_constants_that_steer_the_identification_do_not_grow() -> None:
    steering = [number for number in constants() if number.steers_identification]
    assert 0 < len(steering) <= 100


def test_every_shortcut_is_switched_off_where_verdicts_are_compared() -> None:
    shortcuts = {(c.module, c.name) for c in constants() if c.kind in ("Shortcut", "ShortcutCount", "ShortcutGrid")}
    assert shortcuts <= {(module.__name__, name) for module, name, _ in OFF}
