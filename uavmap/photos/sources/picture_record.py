"""One recorded picture: what is known of it before its pixels are looked at.

A source gives what the file says and no more. A value that the file lacks is None: whether the
picture can do without is for whoever needs the value to say, and somebody may fill it in before
(`dataclasses.replace`): a position from its neighbours, a heading from the ground it shows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from missions.units import LatLon
from vision.lens import Lens


class Measured(NamedTuple):
    """A number and its standard deviation, in the same unit.

    >>> Measured(40.0, 3.0).value
    40.0
    """

    value: float
    sigma: float


class Content(Protocol):
    """The pixels of a picture, where they lie. Safe to use from several threads."""

    @property
    def size_bytes(self) -> int:
        """How long the file is; pictures of different sizes have different contents."""
        ...

    def digest(self) -> str:
        """SHA-256 of the content, hexadecimal; equal contents have equal ones.

        Raises `ImageError` when it cannot be read.
        """
        ...

    def decode(self, max_width_px: int) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """The picture, scaled down to at most `max_width_px` columns, never up.

        Shape (rows, columns, 3), blue-green-red, or (rows, columns) where it has one band; uint8,
        or uint16 where the file has more than 8 bits. The rows are as they are stored: an
        orientation of the tags is not applied. Raises `ImageError` for what cannot be decoded.
        """
        ...


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture of a source, with its tags.

    Attributes:
        name: Unique within the source: the path below it, with "/" in it; of a video, its name and
            the number of the frame.
        content: The pixels, not decoded yet.
        width_px: Columns at full size.
        height_px: Rows at full size.
        taken_s: When it was taken, in seconds by `clock`; None where nothing says.
        clock: `utc`: since 1970. `camera`: since 1970 by a clock without a zone; differences hold
            within a set. `relative`: since the recording began.
        position: Where the camera was, WGS84.
        position_sigma_m: Its standard deviation, horizontally: of one coordinate.
        height_m: The camera above the place of take-off, which is taken for the ground.
        amsl_m: The camera above sea level, or above the ellipsoid: many cameras do not say which.
        yaw_deg: True bearing of the picture's upper edge where it looks straight down, else of the
            optical axis; 0 to 360.
        pitch_deg: Of the optical axis: -90 looks straight down, 0 at the horizon.
        roll_deg: About the optical axis' level; 0 is upright.
        lens: The intrinsics at full size; None where the file does not tell a focal length.
        lens_from: What tells them, in words; empty where nothing does.
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

    def decode(self, max_width_px: int) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """See `Content.decode`."""
        return self.content.decode(max_width_px)


class Refused(NamedTuple):
    """Something of a source that should be a picture and is none that can be read."""

    name: str
    reason: str


class PictureSource(Protocol):
    """A place with recorded pictures. Reading it takes no picture's pixels into memory."""

    @property
    def name(self) -> str:
        """What to call it to the user."""
        ...

    def pictures(self) -> Iterator[Picture | Refused]:
        """Every picture, in a fixed order, one at a time; the same each time it is called.

        A bad picture never ends the iteration. Raises `ImageError` when the source as a whole
        cannot be read.
        """
        ...

    def left_out(self) -> Sequence[str]:
        """What else lies there and is not read, a line a kind; known once `pictures` is through."""
        ...
