"""A camera that the autopilot triggers, as a source.

The autopilot reports the pose of each exposure (CAMERA_FEEDBACK), a folder has the picture; they
are matched by time. One without a partner is lost, and logged: a picture at a wrong place is worse.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import LinkError
from missions.units import LatLon, Quaternion
from uavmap.aircraft.cameras.folder import Card, CardClock, CardPicture, Log, Slowly
from uavmap.aircraft.cameras.mavlink import CommandedSource
from uavmap.aircraft.cameras.pose import Mount
from uavmap.aircraft.cameras.source import Announcement, ReportedPose, nothing_came
from uavmap.mavlink.continuity import RecentLeast
from uavmap.mavlink.session import Message, Session

MAX_PARTNER_WAIT_S: Final = 5.0
"""Maximum wait of a picture for its feedback, and of a feedback for its picture, s."""
MAX_DIFFERENCE_SHARE: Final = 0.5
"""Maximum difference in time of two partners, as a share of the interval."""
_SHORTEST_S: Final = 0.4
_LEAD_WINDOW_S: Final = 30.0
_CLOCK_SET_S: Final = 60.0
_LOOK_S: Final = 0.2


@dataclass(frozen=True, slots=True)
class _Shot:
    """An exposure that the autopilot has reported."""

    index: int
    taken_s: float
    reported: ReportedPose


class TriggeredSource(CommandedSource):
    """The pictures that the autopilot at the other end of a session has triggered."""

    def __init__(
        self,
        session: Session,
        mount: Mount,
        folder: Path,
        latency_s: float,
        say: Log,
        slowly: Slowly[Any] = asyncio.to_thread,
    ) -> None:
        view = session.view
        super().__init__(
            session, lambda: view.autopilot_component or int(mav.MAV_COMP_ID_AUTOPILOT1)
        )
        self._mount = mount
        self._card = Card(folder, latency_s, say, slowly)
        self._interval_s = 1.0
        self._active = False
        self._stopped_s = -math.inf
        self._last_index: int | None = None
        self._clock = CardClock(_CLOCK_SET_S, RecentLeast(_LEAD_WINDOW_S))
        self._shots: list[_Shot] = []
        self._pictures: list[CardPicture] = []
        session.listen(self._on_message, "CAMERA_FEEDBACK")

    # --- orders ------------------------------------------------------------------------------
    async def start(
        self, interval_s: float, count: int, coming: Callable[[], bool] = nothing_came
    ) -> None:
        """Have the autopilot trigger. Raises `CommandRefusedError`, `LinkError`."""
        self._interval_s, self._active = interval_s, True
        self._shots.clear()
        await super().start(interval_s, count, coming)

    def stop(self) -> None:
        """Have it stop; pictures triggered until now may still come."""
        if self._active:
            self._stopped_s = asyncio.get_running_loop().time()
        self._active = False
        super().stop()

    # --- exposures ---------------------------------------------------------------------------
    def _on_message(self, message: Message) -> None:
        if message.img_idx == self._last_index:
            return
        self._last_index = message.img_idx
        taken_s = self._taken_s(message.time_usec)
        if taken_s < self._ordered_s - _SHORTEST_S:
            return  # before the order
        if not self._active and taken_s > self._stopped_s:
            return  # triggered by another
        position = None
        if not message.lat == message.lng == 0:
            position = LatLon(message.lat / 1e7, message.lng / 1e7)
        angles = (math.radians(a) for a in (message.roll, message.pitch, message.yaw))
        attitude = self._mount.attitude(Quaternion.from_euler(*angles))
        reported = ReportedPose(position, message.alt_rel, attitude)
        self._shots.append(_Shot(message.img_idx, taken_s, reported))
        self._bring_together()

    def _taken_s(self, time_usec: int) -> float:
        """Return the exposure on the loop's clock: the fastest feedback shows the difference
        best."""
        now_s = asyncio.get_running_loop().time()
        if time_usec == 0:  # it does not know the time yet
            return now_s
        return min(self._clock.taken_s(time_usec / 1e6, now_s), now_s)

    # --- pictures ----------------------------------------------------------------------------
    async def begin(self) -> None:
        """Note the existing files of the folder. Raises `LinkError` without one."""
        await self._card.begin()

    async def run(self) -> None:
        """Watch the folder until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._card.run(self._add_picture))
            while True:
                await asyncio.sleep(_LOOK_S)
                self._give_up()

    def _add_picture(self, picture: CardPicture) -> None:
        self._pictures.append(picture)
        self._bring_together()

    def _bring_together(self) -> None:
        """Announce each picture with the nearest exposure, if nearer than half of the interval.

        After a lost feedback, the next one belongs to the neighbour.
        """
        most_s = MAX_DIFFERENCE_SHARE * self._interval_s
        for picture in list(self._pictures):
            near = min(
                self._shots, key=lambda shot: abs(shot.taken_s - picture.taken_s), default=None
            )
            if near is None or abs(near.taken_s - picture.taken_s) >= most_s:
                continue
            self._pictures.remove(picture)
            self._shots.remove(near)
            path = picture.path
            self._announce(near, str(path), partial(self._card.load, path))

    def _announce(self, shot: _Shot, name: str, load: Callable[[], Any]) -> None:
        self._deliver(
            Announcement(name, shot.taken_s, load, reported=shot.reported, kind="CAMERA_FEEDBACK")
        )

    def _give_up(self) -> None:
        now_s = asyncio.get_running_loop().time()
        refuse = self._session.view.gate.refuse
        for picture in [p for p in self._pictures if now_s - p.taken_s > MAX_PARTNER_WAIT_S]:
            self._pictures.remove(picture)
            if self._active:
                refuse("picture", "no CAMERA_FEEDBACK of its time; see camera.latency_s", now_s)
        for shot in [s for s in self._shots if now_s - s.taken_s > MAX_PARTNER_WAIT_S]:
            self._shots.remove(shot)
            self._announce(shot, f"picture {shot.index}", partial(self._missing, shot))

    async def _missing(self, shot: _Shot) -> bytes:
        raise LinkError(
            f"picture {shot.index}: the autopilot triggered it, but none of its time came into "
            f"{self._card.folder}"
        )
