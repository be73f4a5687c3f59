"""Wait for a vehicle without keeping the operator in the dark: for what, and for how long.

Why it is not ready a vehicle says in words, which are told as they come
(`uavmap.aircraft.autopilot_texts`).
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from uavmap.mavlink.session import Session

FIRST_S: Final = 10.0
"""What takes longer is told."""
AGAIN_S: Final = 30.0
LOOK_S: Final = 1.0


class Waiting:
    """One wait for one vehicle. `tell` takes a line for the operator."""

    def __init__(self, name: str, session: Session, tell: Callable[[str], None]) -> None:
        self._name = name
        self._session = session
        self._tell = tell
        self._begin_s = asyncio.get_running_loop().time()
        self._due_s = self._begin_s + FIRST_S

    async def until(
        self, condition: Callable[[], bool], timeout_s: float, what: Callable[[], str]
    ) -> bool:
        """`Session.until`; tells what is waited for."""
        loop = asyncio.get_running_loop()
        end_s = loop.time() + timeout_s
        while (left_s := end_s - loop.time()) > 0.0:
            if await self._session.until(condition, min(left_s, LOOK_S)):
                return True
            if loop.time() >= self._due_s:
                self._remind(what())
        return condition()

    def _remind(self, what: str) -> None:
        now_s = asyncio.get_running_loop().time()
        self._due_s = now_s + AGAIN_S
        self._tell(f"{self._name}: waits for {what}, for {now_s - self._begin_s:.0f} s by now")
        view = self._session.view
        if view.system_id and not view.armed and not view.ready_to_arm:
            # an ArduPilot gives its reasons every half minute, or when asked
            self._session.send_command(mav.MAV_CMD_RUN_PREARM_CHECKS)
