"""A few of the kept frames: those that were taken nearest to the boundary, around it."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from pathlib import PurePath
from typing import Final, NamedTuple

import numpy as np
import shapely

from missions.errors import ImageError
from uavmap.base.image_files import MAX_PICTURE_BYTES, opened
from uavmap.base.printable import printable
from uavmap.base.text_files import read_bytes
from uavmap.journal.kept_frames import FRAMES, KeptFrame
from uavmap.output.facts.flown_mission import Flown
from uavmap.output.facts.map_model import drift_m, on_ground
from uavmap.output.formats.map_layers import kept_by_time

MOST: Final = 8
_WIDE_PX: Final = 280
_QUALITY: Final = 70


class Shown(NamedTuple):
    """A picture for the page."""

    name: str
    kept: KeptFrame
    address: str
    """With the picture in it: `data:image/jpeg;base64,...`."""


def boundary_frames(flown: Flown) -> list[Shown]:
    """Return at most `MOST` readable frames, in their order along the boundary."""
    kept = list(kept_by_time(flown).values())
    shown = (_shown(flown, frame) for frame in _nearest(flown, kept))
    return [frame for frame in shown if frame is not None]


def _nearest(flown: Flown, kept: Sequence[KeptFrame]) -> list[KeptFrame]:
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


def _shown(flown: Flown, frame: KeptFrame) -> Shown | None:
    name = PurePath(frame.frame).name  # never a path that leads elsewhere
    try:
        data = read_bytes(flown.folder / FRAMES / name, MAX_PICTURE_BYTES)
        with opened(io.BytesIO(data), name) as picture:
            high = max(1, round(picture.height * _WIDE_PX / picture.width))
            picture.draft("RGB", (_WIDE_PX, high))
            small = picture.convert("RGB").resize((_WIDE_PX, high))
    except (ImageError, OSError, ValueError):
        return None
    buffer = io.BytesIO()
    small.save(buffer, "JPEG", quality=_QUALITY)
    text = base64.b64encode(buffer.getvalue()).decode()
    return Shown(printable(name), frame, f"data:image/jpeg;base64,{text}")
