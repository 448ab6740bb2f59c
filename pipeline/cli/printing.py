"""What a command prints of an answer."""

from typing import Any

from pipeline import settings
from pipeline.library.answer import Answer


def print_answer(answer: Answer[Any]) -> None:
    """Its sentences, and where its page is."""
    print(answer)
    if answer.report is not None:
        label = "report" if answer.page == "report.html" else "page"
        print(f"{label}: {settings.shown(answer.report)}")
