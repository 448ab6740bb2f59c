"""How the tests run the toy study, and what they read of it."""

from pipeline.engine.runner import Resources
from pipeline.engine.store import Output

ONE = Resources(jobs=1, chunk=10)


def hashes(outputs: dict[str, Output]) -> dict[str, dict[str, str]]:
    return {name: output.hashes for name, output in outputs.items()}


def ran(captured: str) -> list[str]:
    """Names of the stages that ran, from the progress lines."""
    return [line.split()[0] for line in captured.splitlines() if "up to date" not in line]
