"""The command line: studies and their stages, measured units, and what holds the model against the world."""

import importlib
import sys
from collections.abc import Sequence

from pipeline.cli.boundary import answer
from pipeline.cli.parser import parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status: 0, 2 for what the user can mend, 1 for a failure of ours."""
    try:
        options = parser().parse_args(arguments)
        module, _, action = options.command.partition(".")
        getattr(importlib.import_module(f"pipeline.cli.{module}"), action)(options)
    except (Exception, KeyboardInterrupt) as error:
        outcome = answer(error)
        for line in outcome.lines:
            print(line, file=sys.stderr)
        return outcome.status
    return 0
