"""The pictures of a report, small and as text; frames are chosen along the boundary."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from pathlib import Path, PurePath
from typing import Final, NamedTuple

import numpy as np
import shapely

from missions.errors import ImageError
from uavmap.base.image_files import MAX_PICTURE_BYTES, opened
from uavmap.base.printable import printable
from uavmap.base.text_files import read_bytes
from uavmap.journal.kept_frames import FRAMES, KeptFrame
from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.facts.map_model import drift_m, on_ground
from uavmap.output.formats.map_layers import kept_by_time

MOST: Final = 8
_WIDE_PX: Final = 280
_QUALITY: Final = 70


class PagePicture(NamedTuple):
    """A picture for the page."""

    name: str
    kept: KeptFrame
    address: str
    """Address that holds the picture: `data:image/jpeg;base64,...`."""


def boundary_frames(flown: FlownMission) -> list[PagePicture]:
    """Return at most `MOST` readable frames, in their order along the boundary."""
    shown = []
    for frame in _nearest(flown, list(kept_by_time(flown).values())):
        name = PurePath(frame.frame).name  # never a path to another folder
        found = address(flown.folder / FRAMES / name, _WIDE_PX)
        if found is not None:
            shown.append(PagePicture(printable(name), frame, found))
    return shown


def _nearest(flown: FlownMission, kept: Sequence[KeptFrame]) -> list[KeptFrame]:
    """Return the frame over each of some points at equal distances along the boundary."""
    grid, boundary = flown.data.grid, flown.boundary
    if not kept:
        return []
    if boundary is not None and not boundary.region.is_empty:
        moved_m = drift_m(grid, flown.data.t_s)
        line = shapely.transform(boundary.region.boundary, lambda points: points - moved_m)
    else:
        line = flown.extent.outline.boundary
    if line.is_empty:
        return []
    longest = max(shapely.get_parts(line), key=lambda ring: ring.length)
    points = shapely.get_coordinates(
        [longest.interpolate((i + 0.5) / MOST, normalized=True) for i in range(MOST)]
    )
    places = [frame.pose.position for frame in kept]
    degrees = np.array([(place.lon_deg, place.lat_deg) for place in places], dtype=np.float64)
    taken = on_ground(degrees, grid) - [drift_m(grid, frame.t_s) for frame in kept]
    found: list[int] = []
    for point in points:
        order = np.argsort(np.hypot(*(taken - point).T))
        best = next((int(i) for i in order[:MOST] if int(i) not in found), None)
        if best is not None:
            found.append(best)
    return [kept[i] for i in found]


def address(path: Path, wide_px: int) -> str | None:
    """Return an address that holds a picture; None for an unreadable picture."""
    data = small_jpeg(path, wide_px)
    return None if data is None else f"data:image/jpeg;base64,{base64.b64encode(data).decode()}"


def small_jpeg(path: Path, wide_px: int) -> bytes | None:
    """Return a picture as a JPEG of a width; None for an unreadable picture."""
    try:
        data = read_bytes(path, MAX_PICTURE_BYTES)
        with opened(io.BytesIO(data), path.name) as picture:
            high = max(1, round(picture.height * wide_px / picture.width))
            picture.draft("RGB", (wide_px, high))
            small = picture.convert("RGB").resize((wide_px, high))
    except (ImageError, OSError, ValueError):
        return None
    buffer = io.BytesIO()
    small.save(buffer, "JPEG", quality=_QUALITY)
    return buffer.getvalue()
