"""When a picture was taken, by its own tags and by when it appeared."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from PIL import ExifTags

from missions.errors import ImageError
from uavmap.base.image_files import opened
from uavmap.mavlink.continuity import RecentLeast

_WINDOW_S: Final = 60.0
_SAME_CLOCK_S: Final = 30.0
"""By more than this a file does not come late: the camera's clock was set."""


def exif_time_s(path: Path) -> float | None:
    """The time of EXIF DateTimeOriginal with SubsecTimeOriginal, in seconds of the camera's clock.

    None where a tag is missing: whole seconds are too coarse to tell where a copter was.
    """
    try:
        with opened(path, str(path)) as picture:
            detail = picture.getexif().get_ifd(ExifTags.IFD.Exif)
    except ImageError:
        return None
    text = str(detail.get(ExifTags.Base.DateTimeOriginal, "")).strip("\0 ")
    parts = str(detail.get(ExifTags.Base.SubsecTimeOriginal, "")).strip("\0 ")
    if not (parts.isascii() and parts.isdigit()):
        return None
    try:
        whole = datetime.strptime(text, "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC).timestamp()
    except ValueError:
        return None
    return whole + float(f"0.{parts}")


@dataclass(slots=True)
class CardClock:
    """A camera's clock beside ours: the file that came fastest after its exposure tells it best.

    >>> clock = CardClock()
    >>> clock.taken_s(100.0, 12.3), clock.taken_s(101.0, 13.5)
    (12.3, 13.3)
    """

    _lead: RecentLeast = field(default_factory=lambda: RecentLeast(_WINDOW_S))

    def taken_s(self, exif_s: float, appeared_s: float) -> float:
        """When, on our clock, a picture was taken, later by the least time that a file takes."""
        lead_s, least_s = appeared_s - exif_s, self._lead.value
        if least_s is not None and abs(lead_s - least_s) > _SAME_CLOCK_S:
            self._lead.clear()
        self._lead.add(lead_s, appeared_s)
        return round(exif_s + (self._lead.value or 0.0), 6)
