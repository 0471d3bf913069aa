"""Messages from outside: JSON, strictly parsed; all else is no message."""

from typing import Annotated, TypeVar

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

Number = Annotated[int, Field(ge=0, lt=2**53)]

Content = TypeVar("Content")


class StrictModel(BaseModel):
    """Base of all messages: exactly the named fields and types, and only finite numbers."""

    model_config = ConfigDict(
        strict=True, extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True
    )


def parse_json(
    adapter: TypeAdapter[Content], text: str | bytes | None, longest: int
) -> Content | None:
    """Return the content of a JSON text; None if it is too long, not JSON, or of another type.

    adapter: the wanted type. longest: most bytes of the text.
    """
    if text is None or len(text) > longest:
        return None
    try:
        return adapter.validate_json(text)
    except (ValidationError, UnicodeError):
        return None
