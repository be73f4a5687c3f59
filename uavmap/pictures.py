"""Pictures from outside, decoded with care: JPEG or PNG, whole, of a size that was looked at
first."""

from __future__ import annotations

import io
import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from missions.errors import ImageError

_FORMATS = ("JPEG", "PNG")  # JPEG takes in MPO: with a preview behind it, as cameras write
_UNREADABLE = (OSError, SyntaxError, ValueError, struct.error, Image.DecompressionBombError)


def read_image(data: bytes, name: str) -> NDArray[np.uint8]:
    """Decode a picture, all of it.

    Pillow decodes, not OpenCV: that fills what is missing of a truncated JPEG with gray and says
    nothing. EXIF orientation is not applied.

    Args:
        data: A JPEG or PNG file.
        name: What to call it in an error.

    Returns:
        Shape (rows, columns, 3), uint8, blue-green-red.

    Raises:
        ImageError: not a picture, or corrupt, or cut short.
    """
    with opened(io.BytesIO(data), name) as picture:
        rgb = np.asarray(picture if picture.mode == "RGB" else picture.convert("RGB"))
    return cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR).astype(np.uint8, copy=False)


@contextmanager
def opened(source: Path | BinaryIO, name: str) -> Iterator[Image.Image]:
    """Open a picture; what goes wrong with it, here or in the block, is an `ImageError`."""
    try:
        with warnings.catch_warnings():
            # Pillow warns of a damaged tag and leaves it out; if it matters, it is missed by name
            warnings.simplefilter("ignore")
            with Image.open(source, formats=_FORMATS) as picture:
                yield picture
    except _UNREADABLE as error:
        raise ImageError(f"{name}: not a readable picture ({error})") from error
