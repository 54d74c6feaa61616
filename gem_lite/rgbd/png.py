"""Pictures as PNG files."""

from __future__ import annotations

import cv2
import numpy as np

from gem_lite.foundations.colors import TABLE

LARGEST = 2**26
"""A picture with more pixels is refused: a small file may claim any size, and would fill the memory."""
LONGEST = 512
"""The longest side (pixels) of a picture of a thing. CLIP sees it smaller still."""
_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def encode(image: np.ndarray) -> bytes:
    """A picture (H, W) or (H, W, 3), uint8 or uint16, as a PNG file. Colours are RGB."""
    channels = image[..., ::-1] if image.ndim == 3 else image
    return cv2.imencode(".png", channels, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].tobytes()


def decode(content: bytes, channels: int, dtype: type, name: object) -> np.ndarray:
    """The picture in a PNG file: (H, W), or (H, W, 3) RGB.

    Args:
        channels, dtype: what the picture must have: 1 or 3, and uint8 or uint16.
        name: names the file in an error message.

    Raises:
        ValueError: the file is cut off or no PNG, has more than `LARGEST` pixels, or is of another kind.
    """
    image = _decode(content, name)
    found = 1 if image.ndim == 2 else image.shape[2]
    if found != channels or image.dtype != dtype:
        wanted = f"{8 * np.dtype(dtype).itemsize}-bit with {channels} channel{'s' if channels > 1 else ''}"
        raise ValueError(f"{name} must be {wanted}, got {8 * image.dtype.itemsize}-bit with {found}")
    return image[..., ::-1].copy() if channels == 3 else image


def decode_any(content: bytes, name: object) -> np.ndarray:
    """The picture of a PNG file of any kind as (H, W, 3) uint8 RGB.

    Gray becomes RGB, and 16 bits become 8. What is transparent shows the table's gray (`colors.TABLE`) behind it. A
    picture with a side of more than `LONGEST` pixels is made smaller.

    Args:
        name: names the file in an error message.

    Raises:
        ValueError: the file is cut off or no PNG, or has more than `LARGEST` pixels.
    """
    image = _decode(content, name)
    if image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    if image.ndim == 2:
        image = np.repeat(image[..., None], 3, axis=-1)
    colored = image[..., 2::-1]
    if image.shape[2] == 4:
        opaque = image[..., 3:] / 255
        colored = np.round(opaque * colored + (1 - opaque) * np.array(TABLE)).astype(np.uint8)
    shrink = LONGEST / max(colored.shape[:2])
    if shrink < 1:
        height, width = (max(1, round(shrink * side)) for side in colored.shape[:2])
        colored = cv2.resize(colored, (width, height), interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(colored)


def pixel_count(content: bytes) -> int:
    """How many pixels a PNG file says that it has, before it is decoded; 0 if it is too short to say it."""
    width, height = (int.from_bytes(content[start : start + 4], "big") for start in (16, 20))
    return width * height


def _decode(content: bytes, name: object) -> np.ndarray:
    """The picture in a PNG file as OpenCV gives it: colours are BGR. Raises ValueError as `decode_any`."""
    # OpenCV fills a cut picture with zeros, but the first chunk of a whole PNG is IHDR and the last one IEND.
    if not content.startswith(_SIGNATURE) or content[12:16] != b"IHDR" or b"IEND" not in content[-12:]:
        raise ValueError(f"{name} is cut off or no PNG")
    if pixel_count(content) > LARGEST:
        width, height = (int.from_bytes(content[start : start + 4], "big") for start in (16, 20))
        raise ValueError(f"{name} must have at most {LARGEST} pixels, got {width} x {height}")
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    if image is None:
        raise ValueError(f"{name} is cut off or no PNG")
    return image
