"""Single parameters of an ArduPilot: read, and set with the new value read back."""

from __future__ import annotations

import asyncio
import math
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from uavmap.link.session import Message, Session

TRIES: Final = 4
WAIT_S: Final = 1.0


@dataclass(frozen=True, slots=True)
class Parameter:
    """A value as the vehicle told it, with its MAV_PARAM_TYPE; integers, too, are numbers."""

    value: float
    type: int


class Parameters:
    """The parameters that were asked for; what else a vehicle tells is passed over."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._asked: str | None = None
        self._answer: asyncio.Future[Parameter] | None = None
        session.listen(self._on_message)

    async def read(self, name: str) -> Parameter | None:
        """What a parameter is; None if the vehicle does not tell: it has none of this name."""
        view = self._session.view
        return await self._asked_for(
            name,
            mav.MAVLink_param_request_read_message(
                view.system_id, view.autopilot_component, name.encode("ascii"), -1
            ),
        )

    async def write(self, name: str, wanted: Parameter) -> bool:
        """Set a parameter; whether the vehicle says that it has this value."""
        view = self._session.view
        told = await self._asked_for(
            name,
            mav.MAVLink_param_set_message(
                view.system_id,
                view.autopilot_component,
                name.encode("ascii"),
                wanted.value,
                wanted.type,
            ),
        )
        return told is not None and math.isclose(told.value, wanted.value, rel_tol=1e-5)

    async def _asked_for(self, name: str, request: Message) -> Parameter | None:
        """The answer to a request, sent up to `TRIES` times: silence is all that a wrong one gets.

        One at a time.
        """
        self._asked = name
        try:
            for _ in range(TRIES):
                self._answer = asyncio.get_running_loop().create_future()
                self._session.send(request)
                try:
                    async with asyncio.timeout(WAIT_S):
                        return await self._answer
                except TimeoutError:
                    continue
        finally:
            self._asked = self._answer = None
        return None

    def _on_message(self, message: Message) -> None:
        if message.get_type() != "PARAM_VALUE" or message.param_id != self._asked:
            return
        if self._answer is not None and not self._answer.done():
            self._answer.set_result(Parameter(message.param_value, message.param_type))
