"""Figures of the commands' pages are made but not printed, half a second each, but where a test looks at them."""

from collections.abc import Iterator

import pytest
from small_study import save_named

from pipeline.figures import style


@pytest.fixture(scope="module", autouse=True)
def figures_left_empty(request: pytest.FixtureRequest) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        if request.module.__name__ not in ("test_names", "test_bounds_command"):
            patch.setattr(style, "save", save_named())
        yield
