"""Differences between the supported autopilots: modes, heights on the wire, streams.

EVENT and CURRENT_MODE of a PX4, which pymavlink's ardupilotmega dialect lacks, are added to its
table: the parser checks and decodes them as all others.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

EVENT: Final = 410
CURRENT_MODE: Final = 436

_LETTERS: Final = {"uint32_t": "I", "uint16_t": "H", "uint8_t": "B"}

Field = tuple[str, str, int]
"""Name, type, and length of the array, 0 for a number."""


def add_message(message_id: int, name: str, crc_extra: int, *fields: Field) -> Any:
    """Add a message to the dialect; return its class, as pymavlink's generator would make it.

    `crc_extra` is the part of its definition in the checksum. The fields are in the order of the
    wire, which is also that of the constructor.
    """
    names, kinds, arrays = (list(column) for column in zip(*fields, strict=True))
    layout = struct.Struct("<" + "".join(f"{n or ''}{_LETTERS[kind]}" for _, kind, n in fields))

    class Added(mav.MAVLink_message):  # type: ignore[misc]
        id, msgname = message_id, name
        fieldnames = ordered_fieldnames = names
        fieldtypes = kinds
        native_format = bytearray("<" + "".join(_LETTERS[kind] for kind in kinds), "ascii")
        orders = tuple(range(len(fields)))
        array_lengths = arrays
        lengths = tuple(max(n, 1) for n in arrays)
        unpacker = layout

        def __init__(self, *values: Any) -> None:
            super().__init__(message_id, name)
            self._fieldnames = names
            self._instance_field, self._instance_offset = None, -1
            for named, value in zip(names, values, strict=True):
                setattr(self, named, value)

        def pack(self, codec: Any, force_mavlink1: bool = False) -> bytes:
            values = [getattr(self, field) for field in names]
            flat = [n for v in values for n in (v if isinstance(v, list | tuple) else (v,))]
            frame: bytes = self._pack(codec, crc_extra, layout.pack(*flat), force_mavlink1)
            return frame

    Added.crc_extra = crc_extra
    mav.mavlink_map[message_id] = Added
    setattr(mav, f"MAVLINK_MSG_ID_{name}", message_id)
    return Added


EventMessage: Final = add_message(
    EVENT,
    "EVENT",
    160,
    ("id", "uint32_t", 0),
    ("event_time_boot_ms", "uint32_t", 0),
    ("sequence", "uint16_t", 0),
    ("destination_component", "uint8_t", 0),
    ("destination_system", "uint8_t", 0),
    ("log_levels", "uint8_t", 0),
    ("arguments", "uint8_t", 40),
)
CurrentModeMessage: Final = add_message(
    CURRENT_MODE,
    "CURRENT_MODE",
    193,
    ("custom_mode", "uint32_t", 0),
    ("intended_custom_mode", "uint32_t", 0),
    ("standard_mode", "uint8_t", 0),
)


_STREAMS: Final = {
    # an ArduPilot also sends one at every change of mode; a PX4 sends one a second at any requested
    # rate, and its mode in CURRENT_MODE
    mav.MAVLINK_MSG_ID_HEARTBEAT: 5.0,
    mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 10.0,
    mav.MAVLINK_MSG_ID_BATTERY_STATUS: 2.0,
    mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 2.0,
    mav.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mav.MAVLINK_MSG_ID_ATTITUDE: 2.0,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Autopilot:
    """One autopilot in the view of its driver.

    It follows targets in the mode `follows`, and leaves the modes `by_itself` for it without the
    pilot.
    """

    name: str
    follows: int
    rtl: int
    land: int
    takes_off_in: int
    by_itself: tuple[int, ...]
    mode_names: Mapping[int, str]
    streams: Mapping[int, float]
    """Message ids and rates, Hz."""
    follow_params: tuple[float, ...]
    """Parameters of MAV_CMD_DO_SET_MODE for `follows`."""
    amsl: bool
    """True if heights of commands are above the sea, else above home."""
    unused_param: float
    """The value of a command's parameter that is not used."""
    reports_failsafe: bool
    """True if system_status CRITICAL means that a failsafe flies, in any mode."""
    place_lead_s: float
    velocity_lead_s: float
    """Lead of each part of a setpoint, s, so that the vehicle is in time."""
    places_lead_s: float
    """Lead of places that are sent instead of a stream, s.

    A vehicle flies towards a place only as fast as it can stop there.
    """
    stream_mode: int
    """Mode in which a stream of setpoints is followed."""
    stream_params: tuple[float, ...]
    """Parameters of MAV_CMD_DO_SET_MODE for it."""
    failsafe_names: Mapping[int, str] = field(default_factory=dict)
    """Names of modes with another meaning while a failsafe flies."""
    received_as: int = mav.MAV_TYPE_ONBOARD_CONTROLLER
    """Our type in our heartbeat: a PX4 sends its texts to ground stations only."""
    fence_by_command: bool = False
    """True if MAV_CMD_DO_FENCE_ENABLE switches its fence off, also in flight."""
    integers_bytewise: bool = False
    """True if the bytes of an integer parameter are in the float field of its message."""
    rests_constant: bool = False
    """True if its estimator reports a constant position of every vehicle at rest."""
    target_taken: tuple[int, ...] = (mav.MAV_RESULT_ACCEPTED,)
    """Answers to a target (MAV_CMD_DO_REPOSITION) that the vehicle flies to."""
    stream_timeout: str | None = None
    """Parameter of the time that it flies on after the end of a stream; None: not changed."""

    @property
    def streams_apart(self) -> bool:
        """True if a stream has a mode of its own, in which other targets do not move it."""
        return self.stream_mode != self.follows

    def altitude_on_wire(self, height_m: float, home_amsl_m: float) -> tuple[int, float]:
        """Return frame and height on the wire of a command for `height_m` above home.

        >>> PX4.altitude_on_wire(12.0, home_amsl_m=488.0)
        (5, 500.0)
        >>> ARDUPILOT.altitude_on_wire(12.0, home_amsl_m=488.0)
        (3, 12.0)
        """
        if self.amsl:
            # a PX4 refuses commands in the equivalent frame 0
            return mav.MAV_FRAME_GLOBAL_INT, home_amsl_m + height_m
        return mav.MAV_FRAME_GLOBAL_RELATIVE_ALT, height_m


ARDUPILOT: Final = Autopilot(
    name="ArduPilot",
    follows=4,
    rtl=6,
    land=9,
    takes_off_in=4,
    by_itself=(),
    mode_names={
        0: "STABILIZE", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 5: "LOITER", 6: "RTL", 9: "LAND",
        16: "POSHOLD", 17: "BRAKE", 21: "SMART_RTL",
    },
    streams={**_STREAMS, mav.MAVLINK_MSG_ID_EKF_STATUS_REPORT: 1.0},
    follow_params=(mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, 4),
    amsl=False,
    unused_param=0.0,
    reports_failsafe=False,
    # measured: it follows an acceleration 0.4 to 0.5 s late, a steady speed without delay
    place_lead_s=0.0,
    velocity_lead_s=0.5,
    places_lead_s=1.4,
    stream_mode=4,
    stream_params=(mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, 4),
    fence_by_command=True,
    stream_timeout="GUID_TIMEOUT",
)  # fmt: skip


def _px4(main: int, sub: int = 0) -> int:
    return main << 16 | sub << 24


_TAKEOFF, _HOLD, _MISSION, _OFFBOARD = _px4(4, 2), _px4(4, 3), _px4(4, 4), _px4(6)

PX4: Final = Autopilot(
    name="PX4",
    follows=_HOLD,
    rtl=_px4(4, 5),
    land=_px4(4, 6),
    takes_off_in=_TAKEOFF,
    by_itself=(_TAKEOFF, _MISSION),
    mode_names={
        _px4(1): "MANUAL", _px4(2): "ALTITUDE", _px4(3): "POSITION", _px4(5): "ACRO",
        _OFFBOARD: "OFFBOARD", _px4(7): "STABILIZED", _TAKEOFF: "TAKEOFF", _HOLD: "HOLD",
        _MISSION: "MISSION", _px4(4, 5): "RTL", _px4(4, 6): "LAND",
    },
    streams={**_STREAMS, mav.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1.0, CURRENT_MODE: 5.0},
    follow_params=(mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, 4, 3),
    amsl=True,
    unused_param=math.nan,
    reports_failsafe=True,
    # measured: its lag is 0.17 to 0.19 s on any path
    place_lead_s=0.2,
    velocity_lead_s=0.2,
    # by its limits on jerk and acceleration it needs 15 m to stop from 6 m/s
    places_lead_s=2.4,
    stream_mode=_OFFBOARD,
    stream_params=(mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, 6),
    # it descends without a position, and names that ALTITUDE
    failsafe_names={_px4(2): "DESCEND"},
    received_as=mav.MAV_TYPE_GCS,
    integers_bytewise=True,
    rests_constant=True,
    # Without the flag that changes the mode it answers "unsupported", and flies there in Hold. With
    # the flag it would take the vehicle back from a pilot, or from a landing by a failsafe.
    target_taken=(mav.MAV_RESULT_ACCEPTED, mav.MAV_RESULT_UNSUPPORTED),
)  # fmt: skip

AUTOPILOTS: Final = {mav.MAV_AUTOPILOT_ARDUPILOTMEGA: ARDUPILOT, mav.MAV_AUTOPILOT_PX4: PX4}
"""Autopilots by HEARTBEAT.autopilot."""
