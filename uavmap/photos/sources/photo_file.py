"""A photograph in a file: JPEG, PNG or TIFF, of 8 or 16 bits, colour, gray or thermal."""

from __future__ import annotations

import hashlib
import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from missions.errors import ImageError, UavmapError
from uavmap.base.image_files import MAX_PIXELS
from uavmap.base.printable import printable
from uavmap.base.text_files import read_text
from uavmap.photos.sources.photo_tags import tags_of
from uavmap.photos.sources.picture_record import Picture, Refused

SUFFIXES: Final = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff"})
"""Endings of photographs, in any case; the first bytes give the format."""
MAX_FILE_BYTES: Final = 700 * 2**20
"""Maximum size of a photograph, bytes: 100 million pixels, three bands of 16 bits."""
_FORMATS: Final = ("JPEG", "PNG", "TIFF")
_SCALED: Final = frozenset({"JPEG", "MPO"})  # an MPO is a JPEG with a preview behind it
_DEEP: Final = frozenset({"I", "I;16", "I;16B", "I;16L", "I;16N", "F"})

Pixels = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True, slots=True)
class FileContent:
    """The pixels of a photograph on disk."""

    path: Path
    size_bytes: int

    def digest(self) -> str:
        """See `uavmap.photos.sources.picture_record.Content`."""
        return hashlib.sha256(self.read()).hexdigest()

    def read(self) -> bytes:
        """Return the bytes of the file. Raises `ImageError`."""
        try:
            return self.path.read_bytes()
        except OSError as error:
            raise ImageError(f"cannot be read ({error.strerror})") from None

    def decode(self, max_width_px: int) -> Pixels:
        """See `uavmap.photos.sources.picture_record.Content`."""
        return decoded(self.read(), max_width_px)


def text_beside(path: Path, most_bytes: int) -> str:
    """Return the text of a file that belongs to pictures. Raises `ImageError`."""
    try:
        return read_text(path, most_bytes)
    except OSError as error:
        raise ImageError(f"{path}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise ImageError(f"{path}: not a text file in UTF-8") from None


def read_photo(path: Path, name: str) -> Picture | Refused:
    """Return the tags of a photograph; its pixels are not decoded."""
    try:
        size_bytes = path.stat().st_size
        if not size_bytes:
            return Refused(name, "the file is empty")
        if size_bytes > MAX_FILE_BYTES:
            return Refused(name, f"{size_bytes} bytes are too many (at most {MAX_FILE_BYTES})")
        with path.open("rb") as file, _opened(file) as picture:
            tags, size = tags_of(picture), picture.size
    except OSError as error:
        return Refused(name, f"cannot be read ({error.strerror})")
    except ImageError as error:
        return Refused(name, str(error))
    return Picture(name, FileContent(path, size_bytes), *size, **tags)


def decoded(data: bytes, max_width_px: int) -> Pixels:
    """Return a picture file's pixels; see `uavmap.photos.sources.picture_record.Content`.

    A JPEG is decoded at a half, a quarter or an eighth if that is large enough, which saves a third
    of the time. The whole file is needed: Pillow reports missing parts, OpenCV fills them with
    gray.
    """
    with _opened(io.BytesIO(data)) as picture:
        if picture.format == "TIFF" and (_deep(picture) or picture.mode in _DEEP):
            pixels = _deep_tiff(data)
        elif picture.mode in _DEEP:
            pixels = _as_uint16(np.asarray(picture))
        else:
            width_px, height_px = picture.size
            if picture.format in _SCALED and max_width_px < width_px:
                rows = max(1, height_px * max_width_px // width_px)
                picture.draft(None, (max_width_px, rows))  # never below the requested size
            pixels = _eight_bits(picture)
    return reduced(pixels, max_width_px)


# --- decoding ------------------------------------------------------------------------------------
@contextmanager
def _opened(file: io.BufferedReader | io.BytesIO) -> Iterator[Image.Image]:
    """Open a picture; its faults, here or in the block, are `ImageError`s."""
    try:
        with warnings.catch_warnings():
            # Pillow warns of a damaged tag and omits it; a tag that matters is reported as missing
            warnings.simplefilter("ignore")
            with Image.open(file, formats=_FORMATS) as picture:
                if picture.width * picture.height > MAX_PIXELS:
                    raise ImageError(
                        f"{picture.width} x {picture.height} px are too many; at most "
                        f"{MAX_PIXELS // 1_000_000} million are decoded"
                    )
                yield picture
    except UavmapError:
        raise
    except MemoryError:
        raise ImageError("memory ran out while it was read; --workers 1 takes least") from None
    except Image.DecompressionBombError:
        raise ImageError(
            f"too many pixels; at most {MAX_PIXELS // 1_000_000} million are decoded"
        ) from None
    except Exception as error:  # decoders raise any error for a damaged file
        text = printable(str(error)).removesuffix(" <_io.BytesIO object>")
        if "identify" in text:
            raise ImageError("not a readable picture (no JPEG, PNG or TIFF)") from error
        raise ImageError(
            f"not a readable picture ({text[:120] or type(error).__name__})"
        ) from error


def _deep(picture: Image.Image) -> bool:
    """Return True if a TIFF has more than 8 bits a sample, whatever Pillow converts them to."""
    bits = getattr(picture, "tag_v2", {}).get(258, (8,))
    return any(int(n) > 8 for n in (bits if isinstance(bits, tuple) else (bits,)))


def _deep_tiff(data: bytes) -> Pixels:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise ImageError("not a readable TIFF picture")
    if image.ndim == 3 and image.shape[2] == 2:
        image = image[:, :, 0]
    if image.ndim == 3 and image.shape[2] > 3:
        image = image[:, :, :3]
    return _as_uint16(np.asarray(image))


def _as_uint16(image: NDArray[np.generic]) -> Pixels:
    """Keep samples of 16 bits; spread others (degrees, radiance) over 16 bits."""
    if image.dtype == np.uint8:
        return image.astype(np.uint8, copy=False)
    if image.dtype == np.uint16:
        return image.astype(np.uint16, copy=False)
    values = image.astype(np.float64)
    known = np.isfinite(values)
    if not known.any():
        raise ImageError("no pixel of the picture has a value")
    low, high = float(values[known].min()), float(values[known].max())
    if low >= 0.0 and high <= 65535.0 and np.issubdtype(image.dtype, np.integer):
        return values.astype(np.uint16)
    spread = (np.where(known, values, low) - low) * (65535.0 / max(high - low, 1e-9))
    return np.round(spread).astype(np.uint16)


def _eight_bits(picture: Image.Image) -> NDArray[np.uint8]:
    if picture.mode in ("1", "L", "LA"):
        return np.array(picture.convert("L"), dtype=np.uint8)
    rgb = np.asarray(picture if picture.mode == "RGB" else picture.convert("RGB"))
    return cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR).astype(np.uint8, copy=False)


def reduced(pixels: Pixels, max_width_px: int) -> Pixels:
    """Return pixels scaled down to at most `max_width_px` columns."""
    rows, columns = pixels.shape[:2]
    if columns <= max_width_px:
        return pixels
    size = (max_width_px, max(1, round(rows * max_width_px / columns)))
    smaller = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    if pixels.dtype == np.uint8:
        return smaller.astype(np.uint8, copy=False)
    return smaller.astype(np.uint16, copy=False)


_OUTLIERS: Final = 0.5  # per cent at either end that may be defects
_NARROW: Final = 0.25
"""Minimum used part of the range of 16 bits; samples that span less are spread over it."""


def eight_bits(image: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Return blue-green-red, 8 bits, of any picture that a source decodes.

    Of 16 bits the upper 8 are used. A thermal sensor uses a few hundred of its 65,536 levels. Such
    a picture is spread between its own darkest and brightest half per cent. Then its levels are no
    temperatures, and the same ground may differ from picture to picture.
    """
    narrow = np.asarray(image, dtype=np.uint8) if image.dtype == np.uint8 else _narrowed(image)
    if narrow.ndim == 2:
        narrow = np.asarray(cv2.cvtColor(narrow, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    return np.ascontiguousarray(narrow, dtype=np.uint8)


def _narrowed(image: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.uint8]:
    low, high = (float(level) for level in np.percentile(image, (_OUTLIERS, 100.0 - _OUTLIERS)))
    if high - low >= _NARROW * 65535.0 or high <= low:
        return (image >> 8).astype(np.uint8)
    spread = (image.astype(np.float32) - low) * (255.0 / (high - low))
    return np.clip(np.round(spread), 0.0, 255.0).astype(np.uint8)
