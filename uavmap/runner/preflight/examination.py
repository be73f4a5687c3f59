"""The examination of one vehicle before a flight, as findings."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Sequence
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError, ImageError, LinkError
from missions.mission.layout import Layout
from missions.mission.schema import CameraSection
from uavmap.aircraft.cameras.source import Announcement, FrameSource
from uavmap.aircraft.cameras.spec import CameraSpec
from uavmap.base.atomic_write import write_bytes
from uavmap.base.image_files import decoded
from uavmap.base.printable import printable
from uavmap.journal.flight_plan import FlightOptions
from uavmap.load.detector_source import region_in_words
from uavmap.mavlink.identity import wait_for_autopilot
from uavmap.mavlink.parameters import Parameters
from uavmap.mavlink.session import Session
from uavmap.runner.flight_links import Link, opened_links
from uavmap.runner.preflight.autopilot_parameters import names_of, parameter_findings
from uavmap.runner.preflight.finding import Finding, bad, for_vehicle, ok, warn
from uavmap.runner.preflight.vehicle_check import Measurement, state_findings
from vision.detectors import Detector
from vision.plausible import implausible

PICTURES: Final = "test-picture-{}.png"
HEARTBEAT_S: Final = 1.0
PICTURE_S: Final = 8.0
"""Maximum wait for an ordered picture, s."""
_MARK = np.array([0, 0, 255], np.uint8)  # red, as OpenCV has it
_REMEDY: Final = (
    "is the camera's program running, on the same link and with the vehicle's system id?"
)


@contextlib.asynccontextmanager
async def open_answering_links(
    options: FlightOptions, cameras: Sequence[CameraSpec], section: CameraSection
) -> AsyncIterator[list[Link]]:
    """Open links as for a flight, and send heartbeats: a vehicle answers only to a sender."""
    async with opened_links(options, cameras, section, lambda frame: None) as links:
        beating = asyncio.create_task(_heartbeats([link.session for link in links]))
        try:
            yield links
        finally:
            beating.cancel()


async def connect(session: Session, name: str) -> None:
    """Wait for an autopilot, and request its telemetry; a missing part is a finding.

    Raises `LinkError` if none answers.
    """
    view = session.view
    await wait_for_autopilot(session, name)
    try:
        for message_id, rate_hz in view.kind.streams.items():
            with contextlib.suppress(CommandRefusedError):  # a stream may come anyway
                await session.message_interval(message_id, rate_hz)
    except LinkError as error:
        raise LinkError(f"{name}: {error}: does the link carry anything to the vehicle?") from None
    session.request(mav.MAVLINK_MSG_ID_HOME_POSITION)


class Examination:
    """The examination of one vehicle; made as soon as there is a session."""

    def __init__(self, number: int, session: Session, camera: FrameSource) -> None:
        self._number = number
        self._session = session
        self._camera = camera
        self._measurement = Measurement(session)
        self._parameters = Parameters(session)

    async def vehicle(self, setting: Layout | None) -> list[Finding]:
        """Return the findings on link, state, battery, failsafes; fewer without a mission."""
        measured = self._measurement
        await measured.measure()
        view = self._session.view
        parameters = await self._parameters.read_many(names_of(view.kind, setting))
        found = state_findings(view, measured, setting, self._number)
        parameters_found = parameter_findings(view.kind, parameters, setting, measured.volts)
        return for_vehicle(self._number, [*found, *parameters_found])

    async def camera(self, setting: Layout, detector: Detector, folder: Path) -> list[Finding]:
        """Take a picture, judge it, and save it with the detector's marks as a PNG in a folder."""
        camera, optics = setting.mission.camera, setting.mission.camera.optics
        size_px = (optics.width_px, optics.height_px)
        patience_s = max(PICTURE_S, 4 * self._session.ack_wait_s)
        try:
            picture = await _picture(self._camera, camera.interval_s, patience_s)
            image = decoded(await picture.load(), picture.name, size_px)
        except (LinkError, ImageError) as error:
            wanted = f"a picture of {size_px[0]} x {size_px[1]} px"
            found = bad("camera", printable(str(error)), wanted, _REMEDY, binding=True)
            return for_vehicle(self._number, [found])
        mask = detector.mask(image)
        overlay = folder / PICTURES.format(self._number)
        text = (
            f"a picture of {size_px[0]} x {size_px[1]} px; "
            f"{100 * float(np.count_nonzero(mask)) / mask.size:.0f} % of it is region: "
            f"{region_in_words(setting.mission.detector)}"
        )
        try:
            overlay.parent.mkdir(parents=True, exist_ok=True)
            write_bytes(overlay, _drawn_over(image, mask))
            text += f" ({overlay})"
        except OSError as error:
            text += f" ({overlay} cannot be written: {error.strerror})"
        found = ok("camera", text)
        if reason := implausible(image, noiseless=camera.noiseless):
            remedy = "take the lens cap off; lying on the ground it may see nothing"
            found = warn("camera", f"{text}; {reason}", "a picture of the ground", remedy)
        return for_vehicle(self._number, [found])


async def _picture(source: FrameSource, interval_s: float, patience_s: float) -> Announcement:
    first: asyncio.Future[Announcement] = asyncio.get_running_loop().create_future()
    source.listen(lambda picture: None if first.done() else first.set_result(picture))
    source.uncertain()
    await source.start(interval_s, 1, first.done)
    try:
        async with asyncio.timeout(patience_s):
            return await first
    except TimeoutError:
        raise LinkError("the camera got an order for a picture, and none came") from None
    finally:
        source.stop()


def _drawn_over(image: NDArray[np.uint8], mask: NDArray[np.uint8]) -> bytes:
    drawn = image.copy()
    marked = mask > 0
    drawn[marked] = (drawn[marked] // 2 + _MARK // 2).astype(np.uint8)
    _, data = cv2.imencode(".png", drawn)
    return bytes(data)


async def _heartbeats(sessions: Sequence[Session]) -> None:
    while True:
        for session in sessions:
            session.heartbeat()
        await asyncio.sleep(HEARTBEAT_S)
