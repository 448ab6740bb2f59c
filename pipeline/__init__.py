"""Tolerance studies of cycloid reducers from Python; each name is imported when it is used."""

from typing import Any

ROOMS = {
    "Answer": "running",
    "Run": "studies",
    "Workers": "running",
    "allocate": "decisions",
    "assemble": "lots",
    "bounds": "decisions",
    "certificate": "lots",
    "changed": "measured",
    "compare": "decisions",
    "draw_distribution": "drawing",
    "draw_drivers": "drawing",
    "draw_loop": "drawing",
    "identify": "measured",
    "identify_series": "measured",
    "load_design": "studies",
    "load_study": "studies",
    "lots": "lots",
    "parts": "studies",
    "population": "measured",
    "run": "studies",
    "tails": "studies",
}
"""Module of ``pipeline.library`` that has each name."""
__all__ = ["use_root", *ROOMS]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module  # the command line's help must not wait for the libraries

    return getattr(import_module(f"pipeline.library.{ROOMS[name]}" if name in ROOMS else "pipeline.settings"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
