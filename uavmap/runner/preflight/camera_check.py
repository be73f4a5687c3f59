"""A picture taken before the flight: whether the camera answers, and what the detector sees in it.

On the ground a camera is too near to see sharply; what counts is that a picture of the right size
arrives. What the detector marks in it is drawn over it, for people to look at.
"""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.errors import ImageError, LinkError
from uavmap.aircraft.cameras.source import Announcement, FrameSource, decoded
from uavmap.base.atomic_write import write_bytes
from uavmap.base.printable import printable
from uavmap.runner.preflight.finding import Finding, bad, ok, warn
from vision.detectors import Detector
from vision.plausible import implausible

PICTURE_S: Final = 8.0
"""So long a picture that was ordered is waited for."""
_MARK = np.array([0, 0, 255], np.uint8)  # red, as OpenCV has it
_REMEDY: Final = (
    "is the camera's program running, on the same link and with the vehicle's system id?"
)


async def camera_finding(
    source: FrameSource,
    detector: Detector,
    size_px: tuple[int, int],
    overlay: Path,
    *,
    interval_s: float,
    patience_s: float = PICTURE_S,
    noiseless: bool = False,
) -> Finding:
    """Take a picture, judge it, and save it with the detector's marks as a PNG at `overlay`."""
    try:
        picture = await _picture(source, interval_s, patience_s)
        image = decoded(await picture.load(), picture.name, size_px)
    except (LinkError, ImageError) as error:
        return bad(
            "camera", printable(str(error)), f"a picture of {size_px[0]} x {size_px[1]} px",
            _REMEDY, binding=True,
        )  # fmt: skip
    mask = detector.mask(image)
    share = float(np.count_nonzero(mask)) / mask.size
    found = (
        f"a picture of {size_px[0]} x {size_px[1]} px; the detector {detector.name} marks "
        f"{100 * share:.0f} % of it"
    )
    try:
        overlay.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(overlay, _drawn_over(image, mask))
        found += f" ({overlay})"
    except OSError as error:
        found += f" ({overlay} cannot be written: {error.strerror})"
    if reason := implausible(image, noiseless=noiseless):
        return warn(
            "camera", f"{found}; {reason}", "a picture of the ground",
            "take the lens cap off; lying on the ground it may see nothing",
        )  # fmt: skip
    return ok("camera", found)


async def _picture(source: FrameSource, interval_s: float, patience_s: float) -> Announcement:
    """Have one picture taken. Raises `LinkError`."""
    first: asyncio.Future[Announcement] = asyncio.get_running_loop().create_future()
    source.listen(lambda picture: None if first.done() else first.set_result(picture))
    source.uncertain()
    await source.start(interval_s, 1, first.done)
    try:
        async with asyncio.timeout(patience_s):
            return await first
    except TimeoutError:
        raise LinkError("the camera was told to take a picture, and none came") from None
    finally:
        source.stop()


def _drawn_over(image: NDArray[np.uint8], mask: NDArray[np.uint8]) -> bytes:
    """The picture with what the detector marks in red, as PNG."""
    drawn = image.copy()
    marked = mask > 0
    drawn[marked] = (drawn[marked] // 2 + _MARK // 2).astype(np.uint8)
    _, data = cv2.imencode(".png", drawn)
    return bytes(data)
