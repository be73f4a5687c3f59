"""Everything that is looked at on one vehicle before a flight, as findings."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError, LinkError
from missions.flight.setting import Setting
from uavmap.aircraft.cameras.source import FrameSource
from uavmap.mavlink.identity import answered
from uavmap.mavlink.parameters import Parameters
from uavmap.mavlink.session import Session
from uavmap.runner.preflight.autopilot_parameters import names_of, parameter_findings
from uavmap.runner.preflight.camera_check import PICTURE_S, camera_finding
from uavmap.runner.preflight.finding import Finding, of_vehicle
from uavmap.runner.preflight.measurement import Listener, Measured
from uavmap.runner.preflight.vehicle_check import state_findings
from vision.detectors import Detector

PICTURES: Final = "test-picture-{}.png"
HEARTBEAT_S: Final = 1.0


async def heartbeats(sessions: Sequence[Session]) -> None:
    """Send our heartbeat until cancelled: a vehicle speaks only where it has heard somebody."""
    while True:
        for session in sessions:
            session.heartbeat()
        await asyncio.sleep(HEARTBEAT_S)


async def connect(session: Session, name: str) -> None:
    """Wait for an autopilot that is flown by this version, and ask for its telemetry.

    Raises `LinkError` where nobody answers; what telemetry is missing shows in the findings.
    """
    view = session.view
    await answered(session, name)
    try:
        for message_id, rate_hz in view.kind.streams.items():
            with contextlib.suppress(CommandRefusedError):  # a stream may come all the same
                await session.message_interval(message_id, rate_hz)
    except LinkError as error:
        raise LinkError(f"{name}: {error}: does the link carry anything to the vehicle?") from None
    session.request(mav.MAVLINK_MSG_ID_HOME_POSITION)


class Examination:
    """What is looked at on one vehicle; made as soon as there is a session."""

    def __init__(self, number: int, session: Session, camera: FrameSource) -> None:
        self._number = number
        self._session = session
        self._camera = camera
        self._listener = Listener(session)
        self._parameters = Parameters(session)

    async def vehicle(self, setting: Setting | None) -> list[Finding]:
        """Link, state, battery, failsafes; without a mission what can be told without."""
        measured: Measured = await self._listener.measure()
        view = self._session.view
        parameters = await self._parameters.read_many(names_of(view.kind, setting))
        found = state_findings(view, measured, setting, self._number)
        told = parameter_findings(view.kind, parameters, setting, measured.volts)
        return of_vehicle(self._number, [*found, *told])

    async def camera(self, setting: Setting, detector: Detector, folder: Path) -> list[Finding]:
        """A test picture."""
        optics, camera = setting.mission.camera.optics, setting.mission.camera
        found = await camera_finding(
            self._camera,
            detector,
            (optics.width_px, optics.height_px),
            folder / PICTURES.format(self._number),
            interval_s=camera.interval_s,
            patience_s=max(PICTURE_S, 4 * self._session.ack_wait_s),
            noiseless=camera.noiseless,
        )
        return of_vehicle(self._number, [found])
