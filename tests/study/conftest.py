"""Data of a design and of a study as their files hold them."""

import tomllib

import pytest
from changed_files import ROOT


@pytest.fixture
def design_data():
    return tomllib.loads((ROOT / "data/designs/pham2017.toml").read_text())
