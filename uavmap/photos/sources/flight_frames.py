"""The pictures that an earlier flight kept (`uavmap fly --keep-frames`)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePath

from missions.errors import ImageError
from uavmap.journal.kept_frames import FRAMES, KeptFrame, read_kept
from uavmap.photos.sources.photo_file import read_photo
from uavmap.photos.sources.picture_record import Picture, Refused
from vision.camera import euler
from vision.lens import Lens
from vision.registration.views import Measured

_POSITION_SIGMA_M = 1.5
_HEIGHT_SIGMA_M = 1.0
_ANGLE_SIGMA_DEG = 2.0


@dataclass(slots=True)
class FlightFrames:
    """The kept pictures of a flight's folder, with their poses in the air."""

    path: Path
    _damaged: list[str] = field(default_factory=list, repr=False)

    def pictures(self) -> Iterator[Picture | Refused]:
        """See `uavmap.photos.sources.picture_record.PictureSource`."""
        self._damaged.clear()
        try:
            for kept in read_kept(self.path):
                if isinstance(kept, str):
                    self._damaged.append(kept)
                else:
                    yield self._picture(kept)
        except (OSError, UnicodeDecodeError) as error:
            raise ImageError(f"{self.path / FRAMES}: its poses cannot be read ({error})") from None

    def left_out(self) -> tuple[str, ...]:
        """See `uavmap.photos.sources.picture_record.PictureSource`."""
        return tuple(self._damaged)

    def _picture(self, kept: KeptFrame) -> Picture | Refused:
        name = PurePath(kept.frame).name  # never a path that leads elsewhere
        found = read_photo(self.path / FRAMES / name, name)
        if isinstance(found, Refused):
            return found
        roll, pitch, yaw = (math.degrees(angle) for angle in euler(kept.pose.attitude))
        lens = None
        if 0.0 < kept.hfov_deg < 180.0:
            lens = Lens.pinhole(math.radians(kept.hfov_deg), found.width_px, found.height_px)
        return replace(
            found,
            taken_s=kept.t_s,
            clock="relative",
            position=kept.pose.position,
            position_sigma_m=_POSITION_SIGMA_M,
            height_m=Measured(kept.pose.height_m, _HEIGHT_SIGMA_M),
            yaw_deg=Measured(yaw % 360.0, _ANGLE_SIGMA_DEG),
            pitch_deg=Measured(pitch, _ANGLE_SIGMA_DEG),
            roll_deg=Measured(roll, _ANGLE_SIGMA_DEG),
            lens=lens,
            lens_from="" if lens is None else "the flight that kept them",
            notes=(),
        )
