"""Tolerance studies of cycloid reducers from Python; each name is imported when it is used."""

from typing import Any

__all__ = ["identify", "identify_series", "load_study", "parts", "run"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module  # the command line's help must not wait for the libraries

    return getattr(import_module("pipeline.api"), name)
