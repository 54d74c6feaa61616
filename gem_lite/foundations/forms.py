"""What a JSON file must hold, checked by pydantic: a form is a class with a field for each entry."""

from __future__ import annotations

import re
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

Text = Annotated[str, Field(min_length=1)]
"""A text that is not empty."""
Whole = Annotated[int, Field(ge=0, lt=2**63)]
"""A whole number from 0 on."""


class Form(BaseModel):
    """The content of a JSON file, or a part of it. Entries that no field names are passed over.

    Nothing is converted: a number in quotes is no number. All numbers are finite.
    """

    model_config = ConfigDict(strict=True, frozen=True, allow_inf_nan=False)

    @classmethod
    def read(cls, content: bytes | str, name: object) -> Self:
        """The form in a file's content.

        Args:
            name: names the content in an error message.

        Raises:
            ValueError: the content is cut off or no JSON, lacks an entry, or an entry is not allowed.
        """
        try:
            return cls.model_validate_json(content)
        except ValidationError as error:
            raise ValueError(_sentence(error, name)) from None


def _sentence(error: ValidationError, name: object) -> str:
    """The first mistake in one sentence."""
    first = error.errors(include_url=False)[0]
    message, entry = first["msg"], " ".join(map(str, first["loc"]))
    match first["type"]:
        case "json_invalid":
            return f"{name} is cut off or no JSON: {message}"
        case "missing":
            *parents, last = first["loc"]
            return f"{name}{''.join(f' {parent}' for parent in parents)} lacks {last}"
        case "value_error":  # It comes from a check of our own.
            allowed = message.removeprefix("Value error, ")
        case _:
            allowed = re.sub(r"^\w+ should", "must", message)
    return f"{name} {entry}".rstrip() + f" {allowed}, got {first['input']!r:.100}"
