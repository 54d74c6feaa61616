"""Pictures as PNG files."""

from __future__ import annotations

import cv2
import numpy as np

LARGEST = 2**26
"""A picture with more pixels is refused: a small file may claim any size, and would fill the memory."""
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
    # OpenCV fills a cut picture with zeros, but the first chunk of a whole PNG is IHDR and the last one IEND.
    if not content.startswith(_SIGNATURE) or content[12:16] != b"IHDR" or b"IEND" not in content[-12:]:
        raise ValueError(f"{name} is cut off or no PNG")
    width, height = (int.from_bytes(content[start : start + 4], "big") for start in (16, 20))
    if width * height > LARGEST:
        raise ValueError(f"{name} must have at most {LARGEST} pixels, got {width} x {height}")
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    if image is None:
        raise ValueError(f"{name} is cut off or no PNG")
    found = 1 if image.ndim == 2 else image.shape[2]
    if found != channels or image.dtype != dtype:
        wanted = f"{8 * np.dtype(dtype).itemsize}-bit with {channels} channel{'s' if channels > 1 else ''}"
        raise ValueError(f"{name} must be {wanted}, got {8 * image.dtype.itemsize}-bit with {found}")
    return image[..., ::-1].copy() if channels == 3 else image
