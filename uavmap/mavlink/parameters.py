"""Parameters of an autopilot: read, and set with the new value read back.

Integers travel as numbers on ArduPilot. On PX4 their four bytes are in the float field of the
message, which then may be anything, including NaN.
"""

from __future__ import annotations

import asyncio
import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from uavmap.mavlink.session import Message, Session

TRIES: Final = 4
WAIT_S: Final = 1.0
AT_ONCE: Final = 10
"""Maximum number of requests at a time: an ArduPilot loses faster ones."""

_INT, _UINT, _FLOAT = struct.Struct("<i"), struct.Struct("<I"), struct.Struct("<f")
_UNSIGNED: Final = (mav.MAV_PARAM_TYPE_UINT8, mav.MAV_PARAM_TYPE_UINT16, mav.MAV_PARAM_TYPE_UINT32)
_FLOATS: Final = (mav.MAV_PARAM_TYPE_REAL32, mav.MAV_PARAM_TYPE_REAL64)


@dataclass(frozen=True, slots=True)
class Parameter:
    """A value as the vehicle reported it, with its MAV_PARAM_TYPE; integers are numbers as well."""

    value: float
    type: int


def on_wire(parameter: Parameter, *, bytewise: bool) -> float:
    """Return the float field of PARAM_SET.

    >>> on_wire(Parameter(1.0, 6), bytewise=True)
    1.401298464324817e-45
    >>> on_wire(Parameter(1.0, 6), bytewise=False)
    1.0
    """
    if not bytewise or parameter.type in _FLOATS:
        return parameter.value
    number = round(parameter.value)
    form = _UINT if parameter.type in _UNSIGNED else _INT
    found: float = _FLOAT.unpack(form.pack(number))[0]
    return found


def from_wire(value: float, kind: int, *, bytewise: bool) -> float:
    """Return the number in the float field of PARAM_VALUE.

    >>> from_wire(on_wire(Parameter(-1.0, 6), bytewise=True), 6, bytewise=True)
    -1.0
    """
    if not bytewise or kind in _FLOATS:
        return value
    form = _UINT if kind in _UNSIGNED else _INT
    return float(form.unpack(_FLOAT.pack(value))[0])


class Parameters:
    """The requested parameters; other reports of a vehicle are ignored."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._asked: set[str] = set()
        self._answers: dict[str, Parameter] = {}
        self._wanted: Parameter | None = None
        """Only value that answers while one is set."""
        self._one_at_a_time = asyncio.Lock()
        session.listen(self._on_message, "PARAM_VALUE")

    async def read(self, name: str) -> Parameter | None:
        """Return a parameter; None if the vehicle does not report one of this name."""
        return (await self.read_many([name])).get(name)

    async def read_many(self, names: Sequence[str]) -> dict[str, Parameter]:
        """Return parameters, without those that the vehicle does not report.

        A wrong name gets no answer, so a missing one is requested up to `TRIES` times.
        """
        found: dict[str, Parameter] = {}
        async with self._one_at_a_time:
            for first in range(0, len(names), AT_ONCE):
                requests = {name: self._request(name) for name in names[first : first + AT_ONCE]}
                found |= await self._wait_for_answers(requests)
        return found

    def _request(self, name: str) -> Message:
        view = self._session.view
        return mav.MAVLink_param_request_read_message(
            view.system_id, view.autopilot_component, name.encode("ascii"), -1
        )

    async def write(self, name: str, wanted: Parameter) -> bool:
        """Set a parameter and read it back; return whether the vehicle has this value then.

        Another value is no answer: a PX4 sends each change once more, up to 50 ms later
        (`mavlink_parameters.cpp`).
        """
        view = self._session.view
        request = mav.MAVLink_param_set_message(
            view.system_id,
            view.autopilot_component,
            name.encode("ascii"),
            on_wire(wanted, bytewise=view.kind.integers_bytewise),
            wanted.type,
        )
        async with self._one_at_a_time:
            for message in (request, self._request(name)):
                if not await self._wait_for_answers({name: message}, wanted):
                    return False
        return True

    async def _wait_for_answers(
        self, requests: dict[str, Message], wanted: Parameter | None = None
    ) -> dict[str, Parameter]:
        self._wanted = wanted
        self._answers, self._asked = {}, set(requests)
        wait_s = max(WAIT_S, self._session.ack_wait_s)
        try:
            for _ in range(TRIES):
                for name in self._asked:
                    self._session.send(requests[name])
                if await self._session.until(lambda: not self._asked, wait_s):
                    break
            return self._answers
        finally:
            self._asked = set()

    def _on_message(self, message: Message) -> None:
        if message.param_id not in self._asked:
            return
        bytewise = self._session.view.kind.integers_bytewise
        value = from_wire(message.param_value, message.param_type, bytewise=bytewise)
        found, wanted = Parameter(value, message.param_type), self._wanted
        if wanted and not math.isclose(found.value, wanted.value, rel_tol=1e-5, abs_tol=1e-6):
            return
        self._answers[message.param_id] = found
        self._asked.discard(message.param_id)
