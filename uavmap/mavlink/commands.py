"""What a vehicle can be told in flight: the verbs that every driver has.

A driver is a way to speak to a vehicle. The default one sends MAVLink commands by its session
(`MavlinkCommands`); the one of `uavmap.mavlink.mavsdk` has MAVSDK do them. Telemetry comes by
the session's view with either, and setpoints and the camera's commands are its messages.

Every verb raises `CommandRefusedError` where the vehicle says no, and `LinkError` where it does
not answer. None of them changes the mode but those that are named for it: a pilot's mode stays.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from uavmap.mavlink.session import Permit, Session

_STAMP_WRAPS_S: Final = 250.0
"""Before a time of transmission loses its milliseconds in a float, it begins anew."""
_LEAPS_WITHIN_S: Final = 1.0
"""Time after a place was taken in which the reported position leaps to it, s."""
_PLACE_ALONE: Final = 0b1101_1111_1000
"""The type mask of a target without velocity, acceleration, yaw and turn rate."""


class MavlinkCommands:
    """The verbs as MAVLink commands of a session: repeated until they are acknowledged.

    `done` says that the vehicle is seen to do it: nobody asks again. A verb that changes the mode
    takes a `permit`, which is asked for before each copy.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._view = session.view

    async def follow(self, permit: Permit) -> None:
        """MAV_CMD_DO_SET_MODE: into the mode in which the vehicle flies to targets."""
        params = self._view.kind.follow_params
        await self._session.command(mav.MAV_CMD_DO_SET_MODE, *params, permit=permit)

    async def follow_stream(self, permit: Permit) -> None:
        """MAV_CMD_DO_SET_MODE: into the mode in which it follows a stream of setpoints."""
        params = self._view.kind.stream_params
        await self._session.command(mav.MAV_CMD_DO_SET_MODE, *params, permit=permit)

    async def arm(self) -> None:
        """MAV_CMD_COMPONENT_ARM_DISARM: motors on."""
        await self._session.command(
            mav.MAV_CMD_COMPONENT_ARM_DISARM, 1, done=lambda: self._view.armed
        )

    async def take_off(self, height_m: float, done: Callable[[], bool], permit: Permit) -> None:
        """MAV_CMD_NAV_TAKEOFF to a height (m) above home, from where it stands, armed."""
        kind = self._view.kind
        _, wire_m = kind.altitude_on_wire(height_m, self._view.home_amsl_m)
        unused = kind.unused_param
        params = (0, 0, 0, unused, unused, unused, wire_m)
        await self._session.command(mav.MAV_CMD_NAV_TAKEOFF, *params, done=done, permit=permit)

    async def fly_to(self, place: LatLon, height_m: float) -> None:
        """MAV_CMD_DO_REPOSITION, without the flag that changes the mode, refused in any but that of
        `follow`. `height_m` is above home, or above the ground there if the view has one."""
        kind = self._view.kind
        above_home_m = height_m + self._view.ground_m(place)
        place = self._view.as_told(place)
        frame, wire_m = kind.altitude_on_wire(above_home_m, self._view.home_amsl_m)
        await self._session.command_at(
            mav.MAV_CMD_DO_REPOSITION,
            frame,
            (-1.0, 0.0, 0.0, float("nan")),
            place.lat_deg,
            place.lon_deg,
            wire_m,
            kind.target_taken,
        )

    def point_to(self, place: LatLon, height_m: float) -> None:
        """SET_POSITION_TARGET_GLOBAL_INT of a place, for a vehicle that refuses `fly_to`: not
        acknowledged, and ignored in any mode but that of streams."""
        view = self._view
        height_m += view.ground_m(place)
        place = view.as_told(place)
        self._session.send(
            mav.MAVLink_set_position_target_global_int_message(
                0,
                view.system_id,
                view.autopilot_component,
                mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
                _PLACE_ALONE,
                round(place.lat_deg * 1e7),
                round(place.lon_deg * 1e7),
                height_m,
                *(0.0,) * 8,
            )
        )

    async def speed(self, speed_m_s: float) -> None:
        """MAV_CMD_DO_CHANGE_SPEED: over ground to targets (m/s), until the mode changes."""
        await self._session.command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, speed_m_s, -1)

    async def descent_speed(self, speed_m_s: float) -> None:
        """MAV_CMD_DO_CHANGE_SPEED: down to targets (m/s), until the mode changes."""
        await self._session.command(mav.MAV_CMD_DO_CHANGE_SPEED, 3, speed_m_s, -1)

    async def you_are_at(self, place: LatLon, sigma_m: float) -> None:
        """MAV_CMD_EXTERNAL_POSITION_ESTIMATE, good to `sigma_m`: taken by either autopilot while it
        has no satellites, but not by a PX4 with optical flow."""
        boot_s = self._view.since_boot_s or 0.0
        self._view.aided_until_s = math.inf
        try:
            await self._session.command_at(
                mav.MAV_CMD_EXTERNAL_POSITION_ESTIMATE,
                mav.MAV_FRAME_GLOBAL,
                (boot_s % _STAMP_WRAPS_S, 0.0, sigma_m, 0.0),
                place.lat_deg,
                place.lon_deg,
                math.nan,
            )
        finally:
            self._view.aided_until_s = asyncio.get_running_loop().time() + _LEAPS_WITHIN_S

    async def land(self, done: Callable[[], bool], permit: Permit) -> None:
        """MAV_CMD_NAV_LAND where it is, which changes the mode."""
        await self._session.command(mav.MAV_CMD_NAV_LAND, done=done, permit=permit)

    async def return_to_launch(self, permit: Permit) -> None:
        """MAV_CMD_NAV_RETURN_TO_LAUNCH, which changes the mode."""
        await self._session.command(mav.MAV_CMD_NAV_RETURN_TO_LAUNCH, permit=permit)
