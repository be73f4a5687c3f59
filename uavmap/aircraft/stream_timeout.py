"""How long a vehicle flies on when its stream of setpoints ends: shortened while paths are flown.

What it was is saved before the flight, and put back with all else
(`uavmap.runner.preflight.autopilot_setup`).

An ArduPilot waits for GUID_TIMEOUT, 3 s by default, in which it flies 18 m at 6 m/s before it
brakes. PX4's own limit is a second, and is left alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from uavmap.mavlink.parameters import Parameter, Parameters
from uavmap.mavlink.session import Session

TIMEOUT_S: Final = 1.0
"""From 6 m/s a real ArduCopter then stands 15 m on, and 27 m with its default."""
LEAST_S: Final = 0.5
"""A link that loses some setpoints must not look like one that has died."""


class StreamTimeout:
    """The timeout of one vehicle.

    `tell` takes a line for the operator.
    """

    def __init__(self, name: str, session: Session, tell: Callable[[str], None]) -> None:
        self._name = name
        self._view = session.view
        self._parameters = Parameters(session)
        self._tell = tell
        self._settled = False
        self._told = False

    async def shorten(self) -> None:
        """Set it to `TIMEOUT_S`, once in a flight; what cannot be set is told once."""
        parameter = self._view.kind.stream_timeout
        if parameter is None or self._settled:
            return
        found = await self._parameters.read(parameter)
        if found is None:
            self._note(f"the vehicle does not tell its {parameter}")
            return
        if LEAST_S <= found.value <= TIMEOUT_S:
            self._settled = True
            return
        if await self._parameters.write(parameter, Parameter(TIMEOUT_S, found.type)):
            self._settled = True
        else:
            self._note(f"{parameter} could not be set")

    def _note(self, reason: str) -> None:
        if not self._told:
            self._told = True
            self._tell(
                f"{self._name}: {reason}: should the link fail, it flies on for as long as it says"
            )
