"""Where inputs and results lie: a setting of the environment, of `use_root`, or the folder of the project itself."""

import os
from pathlib import Path

VARIABLE = "CYCLOID_ROOT"
"""Environment variable with the folder whose `data` holds designs, studies, measured units and runs."""
PROJECT = Path(__file__).parent.parent
"""The checkout that this file lies in, or the folder of installed packages."""


def _root() -> Path:
    """The folder that is named by the environment, else the checkout, else the working directory."""
    if named := os.environ.get(VARIABLE):
        return Path(named)
    return PROJECT if (PROJECT / "data" / "studies").is_dir() else Path.cwd()


ROOT = _root()
RUNS = ROOT / "data" / "runs"
PUBLISHED = ROOT / "data" / "published"


def use_root(folder: str | Path) -> None:
    """Take inputs from `folder`/data and write runs there; designs and studies that come with the package stay."""
    global ROOT, RUNS, PUBLISHED
    ROOT = Path(folder).resolve()
    RUNS, PUBLISHED = ROOT / "data" / "runs", ROOT / "data" / "published"


def shown(path: Path) -> Path:
    """A path as short as it can be typed from here."""
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path
