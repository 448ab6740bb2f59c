"""The name of a contact law against the library of laws, and the stiffness that some ask for."""

from collections.abc import Iterator
from typing import Annotated

from pydantic import AfterValidator
from pydantic_core import PydanticKnownError

from pipeline.config.files.section import MISSING, Mistake


def _check_law_name(name: str) -> str:
    from pipeline.model.contact.line_laws import library  # most programs that read a study need no mechanics

    if name not in library():
        raise PydanticKnownError("literal_error", {"expected": " or ".join(repr(law) for law in library())})
    return name


LawName = Annotated[str, AfterValidator(_check_law_name)]


def stiffness_problems(law: str, stiffness: float | None) -> Iterator[Mistake]:
    """A stiffness that the law asks for and is missing, or one that it derives."""
    from pipeline.model.contact.line_laws import library

    takes_stiffness = library()[law].of_stiffness is not None
    if takes_stiffness and stiffness is None:
        yield Mistake("springs.stiffness_N_per_mm", MISSING, f'law = "{law}" needs the stiffness of a contact')
    elif stiffness is not None and not takes_stiffness:
        requirement = f'law = "{law}" derives it from geometry and material; delete it, or take law = "linear"'
        yield Mistake("springs.stiffness_N_per_mm", stiffness, requirement)
