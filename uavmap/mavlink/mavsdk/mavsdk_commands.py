"""The verbs of a flight, by MAVSDK's plug-in `action` where that does what is meant, and no more.

Where it does not, the same command goes by the plug-in `mavlink_direct`, which MAVSDK repeats and
waits for just so:

* a target: `goto_location` first changes the mode, which would take the vehicle back from a pilot,
  and its frame is one that a PX4 of 2026 refuses;
* a take-off: `takeoff` sets a parameter of a PX4 for the height, and changes an ArduPilot's mode;
* into GUIDED: `hold` is BRAKE on an ArduPilot;
* into OFFBOARD: `offboard` repeats the last setpoint 20 times a second for as long as it lives, so
  that the autopilot could not tell when ours stay away, and it is in metres from wherever the
  estimator began.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError, LinkError
from uavmap.mavlink.autopilots import PX4
from uavmap.mavlink.commands import MavlinkCommands
from uavmap.mavlink.mavsdk.mavsdk_session import MavsdkSession
from uavmap.mavlink.session import Permit

MODE_S: Final = 2.5
"""A mode that was taken shows in a heartbeat within this time."""
_REFUSED: Final = frozenset(
    {
        "COMMAND_DENIED", "COMMAND_DENIED_LANDED_STATE_UNKNOWN", "COMMAND_DENIED_NOT_LANDED",
        "PARAMETER_ERROR", "UNSUPPORTED", "FAILED", "INVALID_ARGUMENT",
    }
)  # fmt: skip
"""MAVSDK's words for a no of the vehicle; all others mean that nothing was heard."""


class MavsdkCommands(MavlinkCommands):
    """The verbs by MAVSDK. `session` sends what no plug-in does, by `mavlink_direct`."""

    def __init__(self, session: MavsdkSession) -> None:
        super().__init__(session)
        self._mavsdk = session

    async def follow(self, permit: Permit) -> None:
        """`action.hold` on a PX4; MAV_CMD_DO_SET_MODE on an ArduPilot."""
        if self._view.kind is PX4:
            await self._act("hold", mav.MAV_CMD_DO_SET_MODE, permit=permit)
        else:
            await super().follow(permit)

    async def arm(self) -> None:
        """`action.arm`, in the mode that follows: in some others it would change the mode first."""
        view = self._view
        await self._mavsdk.until(lambda: view.mode == view.kind.follows, MODE_S)
        await self._act("arm", mav.MAV_CMD_COMPONENT_ARM_DISARM, done=lambda: view.armed)

    async def speed(self, speed_m_s: float) -> None:
        """`action.set_current_speed`."""
        await self._act("set_current_speed", mav.MAV_CMD_DO_CHANGE_SPEED, speed_m_s=speed_m_s)

    async def land(self, done: Callable[[], bool], permit: Permit) -> None:
        """`action.land`."""
        await self._act("land", mav.MAV_CMD_NAV_LAND, done=done, permit=permit)

    async def return_to_launch(self, permit: Permit) -> None:
        """`action.return_to_launch`, which is a change of mode."""
        await self._act("return_to_launch", mav.MAV_CMD_DO_SET_MODE, permit=permit)

    async def _act(
        self,
        what: str,
        command: int,
        *,
        done: Callable[[], bool] = lambda: False,
        permit: Permit | None = None,
        **more: Any,
    ) -> None:
        """Have the plug-in do it; only the command that it stands for may go over the link."""
        told = await self._mavsdk.asked(command, what, permit, **more)
        result = told["result"]
        if result == "SUCCESS" or done():
            return
        if result in _REFUSED:
            await self._mavsdk.hear_why()
            words = result.lower().replace("_", " ")
            raise CommandRefusedError(
                f"{what} was refused: {words}, MAVSDK says" + self._view.recent_texts()
            )
        raise LinkError(f"{what} was not acknowledged, MAVSDK says: {result}")
