"""Foreign pictures, JPEG or PNG: their size is checked before they are decoded whole."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image as PillowImage
from PIL import UnidentifiedImageError

from missions.errors import ImageError, UavmapError
from uavmap.base.printable import printable

Image = NDArray[np.uint8]
"""Shape (rows, columns, 3), blue-green-red."""
MAX_PICTURE_BYTES: Final = 64 * 2**20
MAX_PIXELS: Final = 100_000_000
"""Maximum size of a decoded picture, pixels, which takes some 600 MB for a moment."""

_FORMATS = ("JPEG", "PNG")  # JPEG includes MPO, with a preview behind it, as cameras write


def decoded(picture: bytes | Image, name: str, size_px: tuple[int, int] | None = None) -> Image:
    """Return the pixels of a picture: of a file, whole and without EXIF orientation, or as given.

    Pillow decodes: OpenCV silently fills the missing part of a truncated JPEG with gray. `name` is
    the picture's in errors. Raises `ImageError` for a file that is no picture, corrupt, cut short
    or too large. Before decoding, it also does for a size other than `size_px` (columns, rows).
    """
    if not isinstance(picture, bytes):
        _check_size((picture.shape[1], picture.shape[0]), name, size_px)
        return picture
    if len(picture) > MAX_PICTURE_BYTES:
        raise ImageError(
            f"{printable(name)}: {len(picture)} bytes; a picture has at most {MAX_PICTURE_BYTES}"
        )
    with opened(io.BytesIO(picture), name) as file:
        _check_size(file.size, name, size_px)
        data = (file if file.mode == "RGB" else file.convert("RGB")).tobytes("raw", "BGR")
        return np.frombuffer(data, np.uint8).reshape(file.height, file.width, 3)


def _check_size(size: tuple[int, int], name: str, wanted: tuple[int, int] | None) -> None:
    if wanted not in (None, size):
        raise ImageError(
            f"{printable(name)}: the picture is {size[0]} x {size[1]} px, the "
            f"camera {wanted[0]} x {wanted[1]} px"
        )


@contextmanager
def opened(
    source: Path | BinaryIO, name: str, formats: tuple[str, ...] = _FORMATS
) -> Iterator[PillowImage.Image]:
    """Open a picture, its size checked; a failure here or in the block is an `ImageError`."""
    try:
        with warnings.catch_warnings():
            # Pillow warns of a damaged tag and omits it; a tag that matters is reported as missing
            warnings.simplefilter("ignore")
            with PillowImage.open(source, formats=formats) as picture:
                if picture.width * picture.height > MAX_PIXELS:
                    raise ImageError(
                        f"{printable(name)}: {picture.width} x {picture.height} px are too many; "
                        f"at most {MAX_PIXELS // 1_000_000} million are decoded"
                    )
                yield picture
    except UavmapError:
        raise
    except UnidentifiedImageError as error:  # its own text gives an address in memory
        kinds = ", ".join(formats)
        raise ImageError(f"{printable(name)}: not a readable picture (no {kinds})") from error
    except Exception as error:  # decoders raise any error for a damaged file
        raise ImageError(
            f"{printable(name)}: not a readable picture ({printable(str(error)) or type(error)})"
        ) from error
