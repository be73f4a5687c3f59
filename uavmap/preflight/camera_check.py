"""A picture taken before the flight: whether the camera answers, and what the detector sees in it.

On the ground a camera is too near to see sharply; what counts is that a picture of the right size
arrives. What the detector marks in it is drawn over it, for people to look at.
"""

from __future__ import annotations

import contextlib
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError, ImageError, LinkError
from uavmap.link.session import Message, Session
from uavmap.pictures import read_image
from uavmap.preflight.finding import Finding, bad, ok, warn
from uavmap.printable import printable
from uavmap.results.atomic import write_bytes
from vision.detectors import Detector
from vision.plausible import implausible

PICTURE_S: Final = 8.0
"""So long a picture that was ordered is waited for."""
TRIES: Final = 3
_MARK = np.array([0, 0, 255], np.uint8)  # red, as OpenCV has it
_REMEDY: Final = (
    "is the camera's program running, on the same link and with the vehicle's system id?"
)

Fetch = Callable[[str], Awaitable[bytes]]


async def camera_finding(
    session: Session,
    fetch: Fetch,
    detector: Detector,
    size_px: tuple[int, int],
    overlay: Path,
    *,
    noiseless: bool = False,
) -> Finding:
    """Take a picture, judge it, and save it with the detector's marks as a PNG at `overlay`."""
    try:
        data, url = await _picture(session, fetch)
        image = read_image(data, url, size_px)
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


async def _picture(session: Session, fetch: Fetch) -> tuple[bytes, str]:
    """Order one picture and fetch it. Raises `LinkError`."""
    announced: list[Message] = []

    def note(message: Message) -> None:
        if message.get_type() == "CAMERA_IMAGE_CAPTURED" and not announced:
            announced.append(message)

    session.listen(note)
    camera = session.view.camera_component
    for attempt in range(TRIES):
        with contextlib.suppress(LinkError):  # one that captures rejects a start
            await session.command(mav.MAV_CMD_IMAGE_STOP_CAPTURE, component=camera)
        try:
            await session.command(
                mav.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 1, attempt + 1,
                component=camera, done=lambda: bool(announced),
            )  # fmt: skip
        except CommandRefusedError:
            if attempt == TRIES - 1:
                raise
            continue
        if await session.until(lambda: bool(announced), max(PICTURE_S, 4 * session.ack_wait_s)):
            url = announced[-1].file_url
            return await fetch(url), url
    raise LinkError("the camera accepts an order for a picture, and announces none")


def _drawn_over(image: NDArray[np.uint8], mask: NDArray[np.uint8]) -> bytes:
    """The picture with what the detector marks in red, as PNG."""
    drawn = image.copy()
    marked = mask > 0
    drawn[marked] = (drawn[marked] // 2 + _MARK // 2).astype(np.uint8)
    _, data = cv2.imencode(".png", drawn)
    return bytes(data)
