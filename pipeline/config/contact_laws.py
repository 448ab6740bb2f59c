"""The name of a contact law against the library of laws."""

from typing import Annotated

from pydantic import AfterValidator
from pydantic_core import PydanticKnownError


def _known(name: str) -> str:
    from pipeline.model.contact.line_laws import library  # most programs that read a study need no mechanics

    if name not in library():
        raise PydanticKnownError("literal_error", {"expected": " or ".join(repr(law) for law in library())})
    return name


LawName = Annotated[str, AfterValidator(_known)]
