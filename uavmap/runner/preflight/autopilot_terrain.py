"""The ground as an autopilot's own terrain database knows it, asked point by point.

TERRAIN_CHECK asks for the height at a place, TERRAIN_REPORT answers it: with a spacing of 0 while
the autopilot has not got that part of its database. An ArduPilot reads it from its card, or has a
ground station send it.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence
from typing import Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import LinkError
from missions.units import LatLon
from uavmap.mavlink.autopilots import PX4
from uavmap.mavlink.session import Message, Session

_LOG: Final = logging.getLogger("uavmap.runner.preflight")
AT_ONCE: Final = 8
"""So many places are asked for before answers are waited for: a slow radio holds no more."""
WAIT_S: Final = 1.0
"""Then those that did not come are asked for again."""
PATIENCE_S: Final = 30.0
"""So long nothing new may come: an autopilot reads from its card, or from a ground station."""
_INSTEAD: Final = 'give terrain.dem = "FILE.tif" instead'

Place = tuple[int, int]
"""Latitude and longitude, in units of 1e-7 degrees, as on the wire."""


class AutopilotTerrain:
    """Asks one autopilot."""

    def __init__(self, session: Session, name: str) -> None:
        self._session = session
        self._name = name
        self._known: dict[Place, float] = {}
        self._pending = 0
        self._heard = False

    async def heights(self, places: Sequence[LatLon]) -> list[float]:
        """The heights above the sea at places, in metres.

        Raises `LinkError` where the autopilot has none, or does not answer.
        """
        if self._session.view.kind is PX4:
            raise LinkError(f"{self._name}: a PX4 tells nobody of its terrain; {_INSTEAD}")
        self._session.listen(self._take)
        wanted = [(round(p.lat_deg * 1e7), round(p.lon_deg * 1e7)) for p in places]
        _LOG.info(f"{self._name}: asks the autopilot for the ground at {len(wanted)} places")
        loop = asyncio.get_running_loop()
        came_s = loop.time()
        while missing := [place for place in wanted if place not in self._known]:
            before, asked = len(self._known), missing[:AT_ONCE]
            for lat_e7, lon_e7 in asked:
                self._session.send(mav.MAVLink_terrain_check_message(lat_e7, lon_e7))
            await self._session.until(lambda a=asked: self._all_known(a), WAIT_S)  # type: ignore[misc]
            if len(self._known) > before:
                came_s = loop.time()
            elif loop.time() - came_s > PATIENCE_S:
                raise LinkError(self._refusal(len(missing), len(wanted)))
        return [self._known[place] for place in wanted]

    def _all_known(self, places: Sequence[Place]) -> bool:
        return all(place in self._known for place in places)

    def _take(self, message: Message) -> None:
        if message.get_type() != "TERRAIN_REPORT":
            return
        self._heard = True
        self._pending = message.pending
        if message.spacing > 0:
            self._known[message.lat, message.lon] = float(np.float32(message.terrain_height))

    def _refusal(self, missing: int, wanted: int) -> str:
        if not self._heard:
            return (
                f"{self._name}: the autopilot does not answer TERRAIN_CHECK (is TERRAIN_ENABLE "
                f"1?); {_INSTEAD}"
            )
        return (
            f"{self._name}: the autopilot knows no ground at {missing} of {wanted} places, and "
            f"waits for {self._pending} blocks of it; put terrain data on its card, connect a "
            f"ground station that sends them, or {_INSTEAD}"
        )
