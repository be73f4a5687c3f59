"""One recorded picture before its pixels are decoded.

A source gives what the file says and no more; a missing value is None. Another step may fill it in
(`dataclasses.replace`): a position from its neighbours, a heading from the ground it shows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from missions.units import LatLon
from vision.camera import Lens
from vision.registration.views import Measured


class Content(Protocol):
    """The pixels of a picture, where they lie. Safe to use from several threads."""

    @property
    def size_bytes(self) -> int:
        """Length of the file; pictures of different sizes have different contents."""
        ...

    def digest(self) -> str:
        """Return the SHA-256 of the content, hexadecimal. Raises `ImageError`."""
        ...

    def decode(self, max_width_px: int) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """Return the picture, scaled down to at most `max_width_px` columns, never up.

        Shape (rows, columns, 3), blue-green-red, or (rows, columns) for one band; uint8, or uint16
        if the file has more than 8 bits. Rows are as stored: an orientation of the tags is not
        applied. Raises `ImageError` for what cannot be decoded.
        """
        ...


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture of a source, with its tags.

    Attributes:
        name: Unique in the source: the path below it, with "/"; of a video, its name and the
            frame's number.
        taken_s: Time of exposure by `clock`; None if unknown.
        clock: `utc`: since 1970. `camera`: since 1970 by a clock without a zone; differences hold
            within a set. `relative`: since the recording began.
        position_sigma_m: Its standard deviation: of one horizontal coordinate.
        height_m: The camera above the place of take-off, which counts as the ground.
        amsl_m: The camera above sea level, or the ellipsoid: many cameras do not say which.
        yaw_deg: True bearing of the picture's upper edge where it looks straight down, else of the
            optical axis; 0 to 360.
        pitch_deg: Of the optical axis: -90 looks straight down, 0 at the horizon.
        roll_deg: About the optical axis; 0 is upright.
        lens: The intrinsics at full size; None without a focal length.
        lens_from: Its source in words.
        notes: What was found and could not be used, a line each.
    """

    name: str
    content: Content
    width_px: int
    height_px: int
    taken_s: float | None = None
    clock: Literal["utc", "camera", "relative"] = "camera"
    position: LatLon | None = None
    position_sigma_m: float = 5.0
    height_m: Measured | None = None
    amsl_m: Measured | None = None
    yaw_deg: Measured | None = None
    pitch_deg: Measured | None = None
    roll_deg: Measured | None = None
    lens: Lens | None = None
    lens_from: str = ""
    notes: tuple[str, ...] = ()


class Refused(NamedTuple):
    """Something of a source that should be a picture and cannot be read."""

    name: str
    reason: str


class PictureSource(Protocol):
    """A place with recorded pictures. Reading it loads no pixels."""

    path: Path

    def pictures(self) -> Iterator[Picture | Refused]:
        """Yield every picture, in a fixed order; the same each time.

        A bad picture never ends the iteration. Raises `ImageError` if the whole source is
        unreadable.
        """
        ...

    def left_out(self) -> Sequence[str]:
        """Return what else lies there, a line a kind; known once `pictures` is through."""
        ...
