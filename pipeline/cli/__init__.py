"""The command line: studies and their stages, measured units, and what holds the model against the world."""

import argparse
import gc
import importlib
import sys
from collections.abc import Callable, Sequence

from pipeline.cli.boundary import answer
from pipeline.cli.kept_answers import kept_answer
from pipeline.cli.parser import parser
from pipeline.errors import shortened

ALLOCATED_OBJECTS = 50_000
"""Objects more than freed after which cycles of them are looked for; the 700 of Python cost 4 % of an identification's
time, as modules and their objects stay alive."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status: 0, 2 for what the user can mend, 1 for a failure of ours."""
    return exit_status(_run, parser(), arguments)


def exit_status(
    action: Callable[[argparse.Namespace], None], program: argparse.ArgumentParser, arguments: Sequence[str] | None
) -> int:
    """Exit status of an action on the options of a program; an error is told in lines for the user."""
    gc.set_threshold(ALLOCATED_OBJECTS)
    try:
        action(program.parse_args(arguments))
    except (Exception, KeyboardInterrupt) as error:
        outcome = answer(error)
        for line in outcome.lines:
            print(line, file=sys.stderr)
        return outcome.status
    return 0


def _run(options: argparse.Namespace) -> None:
    if options.opening:
        print(shortened(options.opening.format(**vars(options))), flush=True)  # the imports behind it take seconds
    if former_answer := kept_answer(options):
        for lines, stream in zip(former_answer, (sys.stdout, sys.stderr), strict=True):
            print("".join(f"{line}\n" for line in lines), end="", file=stream)
        return
    from pipeline.engine.progress import Heartbeat  # behind the answers that take a tenth of a second

    module, _, action = options.command.partition(".")
    with Heartbeat(options.name_of_command):
        getattr(importlib.import_module(f"pipeline.cli.{module}"), action)(options)
