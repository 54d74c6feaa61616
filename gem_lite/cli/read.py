"""``gem-lite read``: what a robot understands of a sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

if TYPE_CHECKING:
    from gem_lite.language import Parser

Model = Annotated[
    str,
    Parameter(help="smollm2, a folder or a Hugging Face name of a causal language model, or none: the grammar alone"),
]
Server = Annotated[
    str | None, Parameter(help="address of a server of OpenAI's protocol, such as http://127.0.0.1:8000/v1")
]
Timeout = Annotated[float, Parameter(help="seconds to wait for a server")]


def read(sentence: str, /, *, model: Model = "smollm2", server: Server = None, timeout: Timeout = 20.0) -> None:
    """Print what to pick and where to place it, or the question that the robot asks back.

    The grammar reads what it is sure of. A language model reads the rest.

    Args:
        sentence: what somebody says to the robot

    Examples:
      gem-lite read "the yellow block goes in the green bowl" --model none
    """
    from gem_lite.language import Question, understand

    understood = understand(sentence, parser_of(model, server, timeout))
    if isinstance(understood, Question):
        print(f"question: {understood.text}")
        return
    for queries in understood:
        print(f"{'push' if queries.push else 'pick'}: {queries.pick}\nplace: {queries.place}")


def parser_of(model: str, server: str | None, timeout: float) -> Parser:
    """The parser that the options name. Raises ModelError if its language model cannot be had."""
    from gem_lite.language import parse

    if server is not None:
        from gem_lite.language.asking import AskingParser
        from gem_lite.language.models import Server

        return AskingParser(Server(server, model, timeout))
    if model == "none":
        return parse
    from gem_lite.language import models
    from gem_lite.language.reader import ModelParser

    return ModelParser(models.load(model))
