"""A survey of any number of small photographs, with the tags of a drone's, for benchmarks.

The ground is a patchwork that repeats itself every 460 m: a road with plants on both sides. The
pictures lie in legs of 100, with 75 % overlap along and 50 % across, so more of them show more
ground; or so many of them lie so, and the others above the same ground, a little beside.
"""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from tests.support.photographs import dji, write_photo

WIDTH_PX, HEIGHT_PX = 320, 240
HEIGHT_M = 40.0
GSD_M = HEIGHT_M * 36.0 / 20.0 / WIDTH_PX  # a focal length of 20 mm on film, 36 mm wide
GROUND_PX = 2048
LEG = 100
LAT_DEG, LON_DEG = 46.84, -91.99
_DEG_M = 111_195.0


def ground(seed: int = 1) -> np.ndarray:
    """The patchwork, north up; its edges meet."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(0.0, 12.0, (GROUND_PX, GROUND_PX, 1)).astype(np.float32)
    noise += cv2.resize(rng.normal(0.0, 14.0, (128, 128)).astype(np.float32), (GROUND_PX,) * 2)[
        ..., None
    ]
    image = np.empty((GROUND_PX, GROUND_PX, 3), np.float32)
    image[:] = (70, 120, 80)
    for start in range(0, GROUND_PX, 512):
        image[:, start + 200 : start + 280] = (165, 160, 160)
    image[900:1000] = (165, 160, 160)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def write_survey(folder: Path, count: int, around: int | None = None) -> None:
    """Write so many photographs; from number `around` on, over the ground of the first ones."""
    sheet = ground()
    across_m, along_m = 0.5 * HEIGHT_PX * GSD_M, 0.25 * WIDTH_PX * GSD_M
    rows, columns = np.arange(HEIGHT_PX), np.arange(WIDTH_PX)
    for number in range(count):
        again, place = divmod(number, around or count)
        leg, step = divmod(place, LEG)
        east_m, north_m = step * along_m + 0.7 * again, leg * across_m + 0.3 * again
        top, left = round(-north_m / GSD_M), round(east_m / GSD_M)
        shot = sheet[np.ix_((rows + top) % GROUND_PX, (columns + left) % GROUND_PX)]
        lat = LAT_DEG + north_m / _DEG_M
        lon = LON_DEG + east_m / _DEG_M / math.cos(math.radians(lat))
        tags = {1: "N", 2: _dms(lat), 3: "W", 4: _dms(-lon)}
        second = 2 * number
        taken = f"2016:06:23 {second // 3600:02}:{second // 60 % 60:02}:{second % 60:02}"
        write_photo(
            folder / f"{number:05}.jpg", gps=tags, taken=taken, image=Image.fromarray(shot),
            xmp=dji(RelativeAltitude=f"+{HEIGHT_M:.2f}", GimbalYawDegree="+0.00"),
        )  # fmt: skip


def _dms(deg: float) -> tuple[float, float, float]:
    whole = int(deg)
    minutes = int((deg - whole) * 60)
    return float(whole), float(minutes), round((deg - whole - minutes / 60) * 3600, 5)
