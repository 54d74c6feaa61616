"""Messages with arrays in MessagePack, as openpi's client writes them. No code is ever executed while one is read."""

from __future__ import annotations

from typing import Any

import msgpack
import numpy as np

KINDS = "biuf"
"""The kinds of numbers that an array of a message may hold: truth values, whole and floating point numbers."""


def pack(message: object) -> bytes:
    """A message of dicts, lists, texts, numbers and arrays as bytes."""
    return msgpack.packb(message, default=_pack_numbers)


def unpack(content: bytes) -> object:
    """The inverse of `pack`. Most arrays are read-only, because they share the message's memory.

    Raises:
        ValueError: the bytes are no message, or an array is damaged or of objects.
    """
    try:
        return msgpack.unpackb(content, object_hook=_unpack_numbers, strict_map_key=False)
    except Exception as error:  # Damaged bytes can have any error.
        raise ValueError(f"the message is damaged: {error or type(error).__name__}") from error


def _pack_numbers(value: object) -> object:
    if isinstance(value, np.ndarray | np.generic) and value.dtype.kind not in KINDS:
        raise TypeError(f"a message holds no numbers of the type {value.dtype}")
    if isinstance(value, np.ndarray):
        return {b"__ndarray__": True, b"data": value.tobytes(), b"dtype": value.dtype.str, b"shape": value.shape}
    if isinstance(value, np.generic):
        return {b"__npgeneric__": True, b"data": value.item(), b"dtype": value.dtype.str}
    raise TypeError(f"a message holds no {type(value).__name__}")


def _unpack_numbers(entries: dict) -> Any:  # noqa: ANN401 (an array, a number or a dict)
    if b"__ndarray__" not in entries and b"__npgeneric__" not in entries:
        return entries
    data: Any = entries[b"data"]
    dtype = np.dtype(entries[b"dtype"])
    if dtype.kind not in KINDS:
        raise ValueError(f"an array must hold numbers, got the type {dtype}")
    if b"__npgeneric__" in entries:
        return dtype.type(data)
    numbers = np.frombuffer(data, dtype).reshape(entries[b"shape"])
    return numbers.astype(dtype.newbyteorder("="), copy=False)
